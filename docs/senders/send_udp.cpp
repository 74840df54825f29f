// Joints and wrench to `kinid live udp://127.0.0.1:5005`: one JSON object a line. Copy Sender into the robot's loop.
#include <arpa/inet.h>
#include <unistd.h>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>

struct Sender {
  int out = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in to{};  // and the number of the next line, by which each that is lost is known
  long long number = 0;
  explicit Sender(int port) {
    to.sin_family = AF_INET, to.sin_port = htons(port);
    inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
  }
  static int list(char *at, const char *name, const double *values, int n) {
    int used = std::sprintf(at, ", \"%s\": [", name);
    for (int i = 0; i < n; ++i) used += std::sprintf(at + used, i ? ", %.17g" : "%.17g", values[i]);
    return used + std::sprintf(at + used, "]");
  }
  // when it was measured [ns], n positions [rad], fx fy fz tx ty tz [N, N·m]
  void send(long long t_ns, const double *q, int n, const double *wrench) {
    char line[2048];
    int used = std::sprintf(line, "{\"n\": %lld, \"t_ns\": %lld", number++, t_ns);
    used += list(line + used, "q", q, n);
    used += list(line + used, "wrench", wrench, 6);
    used += std::sprintf(line + used, "}");
    sendto(out, line, used, 0, reinterpret_cast<sockaddr *>(&to), sizeof to);
  }
};

int main(int, char **argv) {  // ./send_udp PORT CYCLES: a robot that nods
  Sender sender(std::atoi(argv[1]));
  for (int k = 0; k < std::atoi(argv[2]); ++k, usleep(1000)) {
    double q[7], wrench[6] = {0, 0, -2.4, 0, 0, 0};
    for (double &angle : q) angle = 0.1 * std::sin(1e-3 * k);
    sender.send(std::chrono::system_clock::now().time_since_epoch() / std::chrono::nanoseconds(1), q, 7, wrench);
  }
}
