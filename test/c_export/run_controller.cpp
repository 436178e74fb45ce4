// Runs an exported controller of two joints as a controller manager does, by lines of commands:
// `rate HZ`, `timeout S`, `configure`, `activate`, `deactivate`, `gain NAME X X`, `publishers N`,
// `reference T POINTS` and a line `T q q dq dq ddq ddq` for each, `update T q dq q dq`. After each
// a line of what was returned (0 is good) and both torques; after an update also q_d, e and
// what ~/torques has. An update that allocates or frees ends the program.
#include <cstdio>
#include <cstdlib>
#include <iostream>

#include "ros2_control_stub.hpp"
#include "controller.cpp"

// Of the address sanitizer.
extern "C" int __sanitizer_install_malloc_and_free_hooks(
  void (*)(const volatile void *, size_t), void (*)(const volatile void *));

static void refuse(const volatile void *, size_t = 0)
{
  if (in_update) {
    std::abort();
  }
}

int main()
{
  __sanitizer_install_malloc_and_free_hooks(
    refuse, [](const volatile void * memory) { refuse(memory); });
  Exported controller;
  double state[4] = {}, effort[2] = {7.0, 7.0};
  for (auto & x : state) {
    controller.state_interfaces_.push_back({&x});
  }
  for (auto & x : effort) {
    controller.command_interfaces_.push_back({&x});
  }
  controller.on_init();
  std::string command;
  while (std::cin >> command) {
    int result = 0;
    if (command == "rate") {
      std::cin >> controller.rate;
    } else if (command == "timeout") {
      std::string text;
      std::cin >> text;
      controller.node->parameters.insert_or_assign("reference_timeout", std::stod(text));
    } else if (command == "configure") {
      result = static_cast<int>(controller.on_configure({}));
    } else if (command == "activate") {
      result = static_cast<int>(controller.on_activate({}));
    } else if (command == "deactivate") {
      result = static_cast<int>(controller.on_deactivate({}));
    } else if (command == "gain") {
      std::string name, one, two;
      std::cin >> name >> one >> two;
      const std::vector<double> values{std::stod(one), std::stod(two)};
      result = !controller.node->on_set({{name, values}}).successful;
    } else if (command == "publishers") {
      std::cin >> controller.node->subscription->publishers;
    } else if (command == "reference") {
      trajectory_msgs::msg::JointTrajectory message;
      int64_t stamp;
      size_t count;
      std::cin >> stamp >> count;
      message.header.stamp = stamp;
      message.joint_names = {"joint2", "a gripper", "joint1"};
      for (size_t k = 0; k < count; ++k) {
        trajectory_msgs::msg::JointTrajectoryPoint point;
        std::cin >> point.time_from_start.t;
        for (auto * row : {&point.positions, &point.velocities, &point.accelerations}) {
          row->resize(3);
          std::string one, two;  // Streams do not read nan.
          std::cin >> one >> two;
          (*row)[2] = std::stod(one);
          (*row)[0] = std::stod(two);
        }
        message.points.push_back(point);
      }
      controller.node->subscription->callback(message);
    } else if (command == "update") {
      int64_t t;
      std::cin >> t;
      for (auto & x : state) {
        std::string text;
        std::cin >> text;
        x = std::stod(text);
      }
      in_update = true;
      result = static_cast<int>(controller.update(t, 1000000));
      in_update = false;
    }
    const auto & tracking =
      realtime_tools::RealtimePublisher<sensor_msgs::msg::JointState>::last["joint2/error"];
    std::printf("%d %.17g %.17g", result, effort[0], effort[1]);
    const auto & torques =
      realtime_tools::RealtimePublisher<sensor_msgs::msg::JointState>::last["V"];
    for (auto & row : {tracking.position, torques.effort}) {
      for (double x : row) {
        std::printf(" %.17g", x);
      }
    }
    std::printf("\n");
  }
  return 0;
}
