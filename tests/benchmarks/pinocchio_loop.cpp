// The same contact-frame quantities by a plain loop over Pinocchio, to compare speeds with.
//
// Usage: pinocchio_loop INPUT OUTPUT ROUNDS. INPUT and OUTPUT hold doubles in the machine's order; the test beside
// this file writes and reads them. Prints the shortest of ROUNDS times, in seconds.
#if __has_include(<pinocchio/multibody.hpp>)
#include <pinocchio/multibody.hpp>
#else
#include <pinocchio/multibody/model.hpp>
#include <pinocchio/multibody/data.hpp>
#endif
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/kinematics.hpp>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

using Eigen::Matrix3d;
using Eigen::Vector3d;
using RowMatrix3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

static pinocchio::SE3 placement(const double *p) {
  return {Eigen::Map<const RowMatrix3d>(p), Eigen::Map<const Vector3d>(p + 9)};
}

int main(int, char **arguments) {
  std::ifstream file(arguments[1], std::ios::binary);
  std::vector<char> bytes((std::istreambuf_iterator<char>(file)), {});
  const double *in = reinterpret_cast<const double *>(bytes.data());
  const int joints = int(in[0]);
  const long n = long(in[1]);
  in += 2;

  pinocchio::Model model;
  pinocchio::JointIndex last = 0;
  for (int j = 0; j < joints; ++j, in += 16) {  // kind, axis, placement; the joint types are those of the URDF parser
    const std::string name = "joint_" + std::to_string(j);
    const auto where = placement(in + 4);
    if (in[0] == 0) last = model.addJoint(last, pinocchio::JointModelRX(), where, name);
    else if (in[0] == 1) last = model.addJoint(last, pinocchio::JointModelRY(), where, name);
    else if (in[0] == 2) last = model.addJoint(last, pinocchio::JointModelRZ(), where, name);
    else last = model.addJoint(last, pinocchio::JointModelRevoluteUnaligned(in[1], in[2], in[3]), where, name);
  }
  const auto sensor = model.addFrame(pinocchio::Frame("sensor", last, 0, placement(in), pinocchio::OP_FRAME));
  const Vector3d tip = Eigen::Map<const Vector3d>(in + 12);
  const double mass = in[15];
  const Vector3d com = Eigen::Map<const Vector3d>(in + 16);
  const Matrix3d inertia = Eigen::Map<const RowMatrix3d>(in + 19);
  const Vector3d gravity = Eigen::Map<const Vector3d>(in + 28), point = Eigen::Map<const Vector3d>(in + 31);
  const Matrix3d axes = Eigen::Map<const RowMatrix3d>(in + 34);  // rows tangent1, tangent2, normal
  const double *q = in + 43, *dq = q + n * joints, *ddq = dq + n * joints, *wrench = ddq + n * joints;

  pinocchio::Data data(model);
  Eigen::VectorXd position(joints), velocity(joints), acceleration(joints);
  std::vector<double> out(9 * n);
  double best = 1e300;
  for (int round = 0; round < std::atoi(arguments[3]); ++round) {
    const auto start = std::chrono::steady_clock::now();
    for (long i = 0; i < n; ++i) {
      position = Eigen::Map<const Eigen::VectorXd>(q + i * joints, joints);
      velocity = Eigen::Map<const Eigen::VectorXd>(dq + i * joints, joints);
      acceleration = Eigen::Map<const Eigen::VectorXd>(ddq + i * joints, joints);
      pinocchio::forwardKinematics(model, data, position, velocity, acceleration);
      const auto &place = pinocchio::updateFramePlacement(model, data, sensor);
      const auto v = pinocchio::getFrameVelocity(model, data, sensor, pinocchio::LOCAL);
      const auto a = pinocchio::getFrameClassicalAcceleration(model, data, sensor, pinocchio::LOCAL);
      const Matrix3d &turn = place.rotation();
      const Vector3d w = v.angular();
      const Vector3d load = mass * (turn.transpose() * gravity - a.linear() - a.angular().cross(com) - w.cross(w.cross(com)));
      const Vector3d force = turn * (Eigen::Map<const Vector3d>(wrench + 6 * i) - load);
      const Vector3d where = axes * (place.translation() + turn * tip - point);
      const Vector3d rate = axes * (turn * (v.linear() + w.cross(tip)));
      const Vector3d push = axes * force;
      double *row = out.data() + i;
      row[0] = -where[2], row[n] = -rate[2];
      row[2 * n] = where[0], row[3 * n] = where[1], row[4 * n] = rate[0], row[5 * n] = rate[1];
      row[6 * n] = push[2], row[7 * n] = push[0], row[8 * n] = push[1];
    }
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
    best = std::min(best, took.count());
  }
  (void)inertia;  // moves the moment alone
  std::ofstream(arguments[2], std::ios::binary).write(reinterpret_cast<const char *>(out.data()), std::streamsize(8 * out.size()));
  std::printf("%.9e\n", best);
}
