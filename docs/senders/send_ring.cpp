// Joints and wrench to `kinid live shm:/dev/shm/kinid`. Copy Ring into the robot's loop; it never waits.
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>

long long now() { return std::chrono::system_clock::now().time_since_epoch() / std::chrono::nanoseconds(1); }

struct Ring {
  static constexpr uint32_t SLOTS = 4096, WIDTH = 21, SIZE = 24 + 8 * WIDTH;  // q, dq, tau of seven joints
  char *map;
  uint64_t count = 0;
  explicit Ring(const char *path) {
    int file = open(path, O_RDWR | O_CREAT | O_TRUNC, 0600);
    if (ftruncate(file, 64 + SLOTS * SIZE)) std::abort();
    map = static_cast<char *>(mmap(nullptr, 64 + SLOTS * SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0));
    const uint32_t head[] = {1, SLOTS, WIDTH, 0}; const uint64_t run = now();
    std::memcpy(map + 32, &run, 8), std::memcpy(map + 8, head, 16), std::memcpy(map, "KINIDSHM", 8);
  }
  std::atomic_ref<uint64_t> word(size_t at) { return std::atomic_ref<uint64_t>(*reinterpret_cast<uint64_t *>(map + at)); }
  // one sample: 1 joints (q, then dq, then tau) or 2 wrench; when it was measured [ns]
  void put(uint32_t kind, int64_t t_ns, const double *numbers, uint32_t n) {
    const size_t at = 64 + count % SLOTS * SIZE;
    word(at).store(0, std::memory_order_seq_cst);
    const uint32_t what[] = {kind, n};
    std::memcpy(map + at + 8, what, 8), std::memcpy(map + at + 16, &t_ns, 8), std::memcpy(map + at + 24, numbers, 8 * n);
    word(at).store(++count, std::memory_order_release), word(24).store(count, std::memory_order_release);
  }
};

int main(int, char **argv) {  // ./send_ring PATH CYCLES: a robot at rest
  Ring ring(argv[1]);
  const double q[7] = {.1, .1, .1, .1, .1, .1, .1}, wrench[6] = {0, 0, -2.4, 0, 0, 0};
  usleep(1000000);  // for a reader that begins now
  for (int k = 0; k < std::atoi(argv[2]); ++k, usleep(1000)) ring.put(1, now(), q, 7), ring.put(2, now(), wrench, 6);
}
