// What an exported controller uses of ROS 2 and ros2_control, for a test without them.
#pragma once
#include <any>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#define RCLCPP_ERROR(logger, ...) (static_cast<void>(logger), std::fprintf(stderr, __VA_ARGS__))
#define PLUGINLIB_EXPORT_CLASS(kind, base) using Exported = kind;

/// Whether the control loop runs, which must not allocate; what is published is another thread's.
inline bool in_update = false;

namespace rclcpp
{
struct Time
{
  int64_t t;
  int32_t sec;
  Time(int64_t x = 0) : t(x), sec(static_cast<int32_t>(x / 1000000000)) {}
  int64_t nanoseconds() const { return t; }
};
using Duration = Time;
struct QoS { explicit QoS(int) {} };
using SystemDefaultsQoS = std::nullptr_t;
struct Parameter
{
  std::string name;
  std::any value;
  std::string get_name() const { return name; }
  std::vector<double> as_double_array() const { return std::any_cast<std::vector<double>>(value); }
  double as_double() const { return std::any_cast<double>(value); }
  int64_t as_int() const { return std::any_cast<int>(value); }
};
template<class T>
struct Subscription
{
  using SharedPtr = std::shared_ptr<Subscription>;
  size_t publishers = 1;
  size_t get_publisher_count() const { return publishers; }
  std::function<void(const T &)> callback;
};
template<class T>
struct Publisher { using SharedPtr = std::shared_ptr<Publisher>; };
namespace node_interfaces
{
struct OnSetParametersCallbackHandle { using SharedPtr = std::shared_ptr<int>; };
}
}  // namespace rclcpp
namespace rcl_interfaces::msg { struct SetParametersResult { bool successful; std::string reason; }; }
namespace rclcpp_lifecycle { struct State {}; }
namespace sensor_msgs::msg
{
struct JointState
{
  struct { rclcpp::Time stamp; } header;
  std::vector<std::string> name;
  std::vector<double> position, velocity, effort;
};
}  // namespace sensor_msgs::msg
namespace trajectory_msgs::msg
{
struct JointTrajectoryPoint
{
  std::vector<double> positions, velocities, accelerations;
  rclcpp::Time time_from_start;
};
struct JointTrajectory
{
  struct { rclcpp::Time stamp; } header;
  std::vector<std::string> joint_names;
  std::vector<JointTrajectoryPoint> points;
};
}  // namespace trajectory_msgs::msg
namespace realtime_tools
{
template<class T>
struct RealtimeBuffer
{
  T data;
  T * readFromRT() { return &data; }
  void writeFromNonRT(const T & x) { data = x; }
};
template<class T>
struct RealtimePublisher
{
  explicit RealtimePublisher(std::shared_ptr<rclcpp::Publisher<T>>) {}
  T msg_;
  bool trylock() { return true; }
  void unlockAndPublish()
  {
    in_update = false;
    last[msg_.name.back()] = msg_;
    in_update = true;
  }
  static inline std::map<std::string, T> last;
};
}  // namespace realtime_tools
namespace controller_interface
{
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration { interface_configuration_type type; std::vector<std::string> names; };
struct Interface
{
  double * value;
  std::optional<double> get_optional() const { return *value; }
  bool set_value(double x) { *value = x; return true; }
};
using OnSet = std::function<rcl_interfaces::msg::SetParametersResult(
      const std::vector<rclcpp::Parameter> &)>;
struct Node
{
  std::map<std::string, std::any> parameters;
  OnSet on_set;
  std::shared_ptr<rclcpp::Subscription<trajectory_msgs::msg::JointTrajectory>> subscription;
  int64_t clock = 0;
  int get_logger() const { return 0; }
  rclcpp::Time now() const { return clock; }
  rclcpp::Parameter get_parameter(const std::string & x) { return {x, parameters.at(x)}; }
  std::shared_ptr<int> add_on_set_parameters_callback(OnSet x) { on_set = x; return nullptr; }
  template<class T, class F>
  auto create_subscription(const std::string &, rclcpp::QoS, F callback)
  {
    subscription = std::make_shared<rclcpp::Subscription<T>>();
    subscription->callback = callback;
    return subscription;
  }
  template<class T>
  std::shared_ptr<rclcpp::Publisher<T>> create_publisher(const std::string &, std::nullptr_t)
  {
    return nullptr;
  }
};
struct ControllerInterface
{
  virtual ~ControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) = 0;
  virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;
  template<class T>
  void auto_declare(const std::string & name, T value) { node->parameters.emplace(name, value); }
  std::shared_ptr<Node> get_node() const { return node; }
  unsigned get_update_rate() const { return rate; }
  std::shared_ptr<Node> node = std::make_shared<Node>();
  unsigned rate = 1000;
  std::vector<Interface> command_interfaces_, state_interfaces_;
};
}  // namespace controller_interface
