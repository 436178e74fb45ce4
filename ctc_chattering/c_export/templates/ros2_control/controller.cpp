// ros2_control controller with a law of ctc_chattering, written by `ctc export-c --ros2-control`.
//
// Every update commands the torque of ctc_law for the measured state and the desired motion. The
// motion comes as trajectory_msgs/JointTrajectory on ~/reference. A new message replaces all points
// from its first instant on. Between two points the motion is the quintic that meets both. Past
// points are dropped. A message with only past points is refused, and one without points stops the
// motion. Before the first point the torque is 0.
//
// The torque is 0 and the update fails if a state is not finite or jumps, if an error is too large
// (ctc_law.h), or if the reference ends in motion. The controller manager then deactivates the
// controller. Activating it starts the law again.
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "ctc_law.h"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"
#include "realtime_tools/realtime_buffer.hpp"
#include "realtime_tools/realtime_publisher.hpp"
#include "sensor_msgs/msg/joint_state.hpp"
#include "trajectory_msgs/msg/joint_trajectory.hpp"

namespace @PACKAGE@_controller
{
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;
using sensor_msgs::msg::JointState;
using trajectory_msgs::msg::JointTrajectory;

constexpr int N = CTC_JOINTS;
/// Largest number of reference points that are kept.
constexpr size_t MAX_POINTS = 60000;
/// Duration of the stop of a motion [ns].
constexpr int64_t BRAKING = std::int64_t(1e9 * @BRAKING_TIME@);
/// Time before a stop begins, so that the update still receives its first point [ns].
constexpr int64_t NOTICE = 20000000;
/// Time between two points of a stop [ns].
constexpr int64_t STEP = 5000000;
constexpr std::array<int, N> CONTINUOUS = CTC_CONTINUOUS;
const std::array<std::string, N> JOINTS = CTC_JOINT_NAMES;
/// Largest factor by which a gain may change at once, as in the node `controller`.
constexpr double MAX_CHANGE = 101.0;
/// Value from which the factor counts if the gain is 0.
constexpr double FROM_ZERO = 10.0;

/// Values of the parameters kp [1/s^2], kv [1/s] and ka [N m].
struct Gains
{
  std::array<double, N> kp = CTC_KP, kv = CTC_KV, ka = CTC_KA;
  bool operator==(const Gains & x) const { return kp == x.kp && kv == x.kv && ka == x.ka; }
  std::array<double, N> * named(const std::string & name)
  {
    return name == "kp" ? &kp : name == "kv" ? &kv : name == "ka" ? &ka : nullptr;
  }
};

/// Position, velocity and acceleration of all joints at an instant [ns].
struct Point
{
  int64_t t;
  std::array<double, N> q, dq, ddq;
};

/// Reference points received since the controller was activated for the `activation`-th time.
struct Reference
{
  int activation = 0;
  std::vector<Point> points;
};

class Controller : public controller_interface::ControllerInterface
{
public:
  CallbackReturn on_init() override
  {
    for (const std::string name : {"kp", "kv", "ka"}) {
      const auto & values = *set_gains_.named(name);
      auto_declare<std::vector<double>>(name, {values.begin(), values.end()});
    }
    auto_declare<double>("reference_timeout", 0.1);
    auto_declare<int>("state_decimation", 1);
    return CallbackReturn::SUCCESS;
  }

  InterfaceConfiguration command_interface_configuration() const override
  {
    return {interface_configuration_type::INDIVIDUAL, interfaces({"effort"})};
  }

  InterfaceConfiguration state_interface_configuration() const override
  {
    return {interface_configuration_type::INDIVIDUAL, interfaces({"position", "velocity"})};
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    const auto node = get_node();
    if (std::abs(1.0 / get_update_rate() - CTC_PERIOD) > 1e-6 * CTC_PERIOD) {
      RCLCPP_ERROR(
        node->get_logger(), "update_rate is %u Hz, but the law was exported for a period of %g s; set update_rate to "
        "%g Hz", get_update_rate(), CTC_PERIOD, 1.0 / CTC_PERIOD);
      return CallbackReturn::ERROR;
    }
    const double timeout = node->get_parameter("reference_timeout").as_double();
    if (!(timeout > 0.0 && timeout <= 1e9)) {
      RCLCPP_ERROR(
        node->get_logger(), "reference_timeout: %g s is not allowed; allowed: > 0 and <= 1e+09",
        timeout);
      return CallbackReturn::ERROR;
    }
    grace_ = std::llround(1e9 * timeout);
    decimation_ = std::max<int64_t>(node->get_parameter("state_decimation").as_int(), 1);
    Gains gains;
    const auto wrong = taken(
      {node->get_parameter("kp"), node->get_parameter("kv"), node->get_parameter("ka")}, gains);
    if (!wrong.empty()) {
      RCLCPP_ERROR(node->get_logger(), "%s", wrong.c_str());
      return CallbackReturn::ERROR;
    }
    set_gains_ = gains;
    gains_.writeFromNonRT(gains);
    on_set_ = node->add_on_set_parameters_callback(
      [this](const std::vector<rclcpp::Parameter> & parameters) { return set(parameters); });
    subscription_ = node->create_subscription<JointTrajectory>(
      "~/reference", rclcpp::QoS(100),
      [this](const JointTrajectory & message) { take(message); });
    tracking_ = publisher("tracking", {"/desired", "/error"}, 2 * N, 2 * N, 0);
    filter_ = publisher("filter", {""}, 0, N, 0);
    torques_ = publisher(
      "torques", {"/nominal", "/compensation", "/robust", "/commanded"}, 0, 0, 4 * N + 1);
    torques_->msg_.name.push_back("V");
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {
    ctc_init(&law_);
    gains_in_force_ = Gains();
    samples_ = updated_ = 0;
    ++activation_;  // Older reference points no longer apply.
    return send({}) ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
  {
    return send({}) ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
  }

  return_type update(const rclcpp::Time & time, const rclcpp::Duration &) override
  {
    const int64_t t = time.nanoseconds();
    const Reference & reference = *reference_.readFromRT();
    now_ = t;
    if (reference.activation != activation_ || t < reference.points.front().t) {
      return send({}) ? return_type::OK : return_type::ERROR;
    }
    const Point & last = reference.points.back();
    if (t > last.t + grace_ && !at_rest(last)) {
      return stop("the reference ended in motion");
    }
    for (int i = 0; i < N; ++i) {
      q_[i] = measured(2 * i);
      dq_[i] = measured(2 * i + 1);
    }
    for (int k = 0; k < CTC_POINTS; ++k) {
      const Point point = desired(reference.points, t + k * static_cast<int64_t>(CTC_PERIOD_NS));
      std::copy(point.q.begin(), point.q.end(), q_d_.begin() + k * N);
      std::copy(point.dq.begin(), point.dq.end(), dq_d_.begin() + k * N);
      std::copy(point.ddq.begin(), point.ddq.end(), ddq_d_.begin() + k * N);
    }
    const Gains & gains = *gains_.readFromRT();
    if (!(gains == gains_in_force_)) {
      ctc_set_gains(&law_, gains.kp.data(), gains.kv.data(), gains.ka.data());
      gains_in_force_ = gains;
    }
    std::array<double, N> tau;
    const double elapsed = updated_ ? static_cast<double>(t - updated_) / 1e9 : CTC_PERIOD;
    updated_ = t;
    const int error = ctc_step_after(
      &law_, elapsed, q_.data(), dq_.data(), q_d_.data(), dq_d_.data(), ddq_d_.data(),
      tau.data());
    if (error != CTC_OK) {
      return stop(ctc_message(error));
    }
    if (!send(tau)) {
      return stop("a command interface refused its value");
    }
    if (samples_++ % decimation_ == 0) {
      publish(time);
    }
    return return_type::OK;
  }

private:
  using Publisher = realtime_tools::RealtimePublisher<JointState>;

  static std::vector<std::string> interfaces(const std::vector<std::string> & kinds)
  {
    std::vector<std::string> names;
    for (const auto & joint : JOINTS) {
      for (const auto & kind : kinds) {
        names.push_back(joint + "/" + kind);
      }
    }
    return names;
  }

  /// Take gains from parameters. Return the reason for a refusal, or an empty string.
  static std::string taken(const std::vector<rclcpp::Parameter> & parameters, Gains & gains)
  {
    for (const auto & parameter : parameters) {
      if (auto * values = gains.named(parameter.get_name())) {
        const auto given = parameter.as_double_array();
        if (given.size() != N) {
          return parameter.get_name() + ": " + std::to_string(given.size()) +
                 " numbers are not allowed; allowed: one number for each joint";
        }
        std::copy(given.begin(), given.end(), values->begin());
      }
    }
    const int error = gains == Gains() ? CTC_OK :
      ctc_check_gains(gains.kp.data(), gains.kv.data(), gains.ka.data());
    return error == CTC_OK ? "" : ctc_message(error);
  }

  static bool at_rest(const Point & point)
  {
    const auto is_zero = [](double x) { return x == 0.0; };
    return std::all_of(point.dq.begin(), point.dq.end(), is_zero) &&
           std::all_of(point.ddq.begin(), point.ddq.end(), is_zero);
  }

  double measured(size_t i) const
  {
    return state_interfaces_[i].get_optional().value_or(std::numeric_limits<double>::quiet_NaN());
  }

  /// Command torques. Return true if all interfaces accept them.
  bool send(const std::array<double, N> & tau)
  {
    bool taken = true;
    for (size_t i = 0; i < command_interfaces_.size(); ++i) {
      taken = command_interfaces_[i].set_value(tau[i]) && taken;
    }
    return taken;
  }

  return_type stop(const char * why)
  {
    send({});
    RCLCPP_ERROR(get_node()->get_logger(), "%s; the torque is 0 until the controller is activated again", why);
    return return_type::ERROR;
  }

  /// Return the desired motion at an instant from the first point on.
  Point desired(const std::vector<Point> & points, int64_t t) const
  {
    const auto after = std::upper_bound(
      points.begin(), points.end(), t, [](int64_t x, const Point & point) { return x < point.t; });
    const Point & a = *(after - 1);
    Point made{t, {}, {}, {}};
    if (t == a.t || after == points.end()) {  // A late reference continues, then rests.
      const double h = static_cast<double>(std::min(t - a.t, grace_)) / 1e9;
      for (int i = 0; i < N; ++i) {
        made.q[i] = a.q[i] + h * a.dq[i];
        made.dq[i] = t <= a.t + grace_ ? a.dq[i] : 0.0;
        made.ddq[i] = t == a.t ? a.ddq[i] : 0.0;
      }
      return made;
    }
    const double h = static_cast<double>(after->t - a.t) / 1e9;
    const double s = static_cast<double>(t - a.t) / 1e9 / h;
    for (int i = 0; i < N; ++i) {
      const double d = after->q[i] - a.q[i], v0 = a.dq[i] * h, v1 = after->dq[i] * h;
      const double a0 = a.ddq[i] * h * h, a1 = after->ddq[i] * h * h;
      const double c2 = 0.5 * a0;
      const double c3 = 10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1;
      const double c4 = -15.0 * d + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1;
      const double c5 = 6.0 * d - 3.0 * (v0 + v1) - 0.5 * (a0 - a1);
      made.q[i] = a.q[i] + s * (v0 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
      made.dq[i] = (v0 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h;
      made.ddq[i] = (2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (h * h);
    }
    return made;
  }

  /// Return a motion that comes to rest on its path from an instant on.
  ///
  /// Its time slows down: at fraction x of BRAKING, s(x) = x - x^3 + x^4 / 2 of BRAKING has passed.
  std::vector<Point> stopping(const std::vector<Point> & points, int64_t begin) const
  {
    std::vector<Point> made;
    for (int64_t t = 0; t <= BRAKING; t += STEP) {
      const double x = static_cast<double>(t) / BRAKING, span = BRAKING / 1e9;
      const double passed = x - x * x * x + 0.5 * x * x * x * x;
      const double rate = 1.0 - x * x * (3.0 - 2.0 * x), change = 6.0 * x * (x - 1.0) / span;
      Point point = desired(points, begin + std::llround(passed * BRAKING));
      point.t = begin + t;
      for (int i = 0; i < N; ++i) {
        point.ddq[i] = rate * rate * point.ddq[i] + change * point.dq[i];
        point.dq[i] *= rate;
      }
      made.push_back(point);
    }
    return made;
  }

  rcl_interfaces::msg::SetParametersResult set(const std::vector<rclcpp::Parameter> & parameters)
  {
    Gains gains = set_gains_;
    rcl_interfaces::msg::SetParametersResult result;
    result.reason = taken(parameters, gains);
    for (const std::string name : {"kp", "kv", "ka"}) {
      const auto & before = *set_gains_.named(name), & after = *gains.named(name);
      for (int i = 0; i < N; ++i) {
        const double from = before[i] > 0.0 ? before[i] : FROM_ZERO;
        if (after[i] > 0.0 && std::max(from / after[i], after[i] / from) > MAX_CHANGE) {
          result.reason = name + ": the change is too large; allowed: a factor of at most 100 at once";
        }
      }
    }
    result.successful = result.reason.empty();
    if (result.successful) {
      set_gains_ = gains;
      gains_.writeFromNonRT(gains);
    }
    return result;
  }

  /// Take a reference message. This thread is not real-time.
  void take(const JointTrajectory & message)
  {
    const auto logger = get_node()->get_logger();
    if (subscription_->get_publisher_count() > 1) {
      RCLCPP_ERROR(
        logger, "~/reference has several publishers; messages from all of them are ignored");
      return;
    }
    std::array<size_t, N> order;
    for (int i = 0; i < N; ++i) {
      const auto & names = message.joint_names;
      order[i] = std::find(names.begin(), names.end(), JOINTS[i]) - names.begin();
    }
    if (message.header.stamp.sec < 0) {  // rclcpp::Time would throw and end the manager.
      RCLCPP_ERROR(logger, "the reference is refused: its stamp is negative");
      return;
    }
    const bool begun = kept_.activation == activation_ && !kept_.points.empty();
    const int64_t stamp = rclcpp::Time(message.header.stamp).nanoseconds();
    const int64_t start = stamp == 0 ? get_node()->now().nanoseconds() : stamp;
    std::vector<Point> chunk;
    for (const auto & point : message.points) {
      Point made{start + rclcpp::Duration(point.time_from_start).nanoseconds(), {}, {}, {}};
      bool good = made.t > (chunk.empty() ? start - 1 : chunk.back().t);
      for (int i = 0; i < N && good; ++i) {
        const size_t j = order[i];
        good = j < point.positions.size() && j < point.velocities.size() &&
          j < point.accelerations.size();
        if (good) {
          made.q[i] = point.positions[j];
          made.dq[i] = point.velocities[j];
          made.ddq[i] = point.accelerations[j];
          good = std::isfinite(made.q[i]) && std::isfinite(made.dq[i]) &&
            std::isfinite(made.ddq[i]);
        }
      }
      if (!good) {
        RCLCPP_ERROR(
          logger, "the reference is refused: every point needs a finite position, velocity and "
          "acceleration of every joint, and times must increase from 0 on");
        return;
      }
      chunk.push_back(made);
    }
    if (chunk.empty()) {
      if (!begun || now_ < kept_.points.front().t) {
        RCLCPP_ERROR(logger, "the reference is refused: it has no points, and there is no motion to stop");
        return;
      }
      chunk = stopping(kept_.points, now_ + NOTICE);
    } else if (now_ > chunk.back().t + grace_) {
      RCLCPP_ERROR(
        logger, "the reference is refused: all of its points are past; the last one is at %.3f s, "
        "and the time is %.3f s; check that the clocks are synchronised", chunk.back().t / 1e9, now_ / 1e9);
      return;
    }
    Reference merged{activation_, {}};
    if (kept_.activation != merged.activation) {
      kept_.points.clear();
    }
    for (size_t i = 0; i < kept_.points.size() && kept_.points[i].t < chunk.front().t; ++i) {
      if (i + 1 == kept_.points.size() || kept_.points[i + 1].t > now_) {  // The present motion needs it.
        merged.points.push_back(kept_.points[i]);
      }
    }
    for (const auto & point : chunk) {
      merged.points.push_back(
        merged.points.empty() ? point : following(point, merged.points.back()));
    }
    if (merged.points.size() > MAX_POINTS) {
      RCLCPP_ERROR(logger, "the reference is refused: it has more than %zu points", MAX_POINTS);
      return;
    }
    kept_ = merged;
    reference_.writeFromNonRT(merged);
  }

  /// Return a point with whole turns added, so that endless joints continue the point before.
  static Point following(Point point, const Point & before)
  {
    const double h = static_cast<double>(point.t - before.t) / 1e9, turn = 2.0 * std::acos(-1.0);
    for (int i = 0; i < N; ++i) {
      const double expected = before.q[i] + 0.5 * h * (before.dq[i] + point.dq[i]);
      const double turns = CONTINUOUS[i] ? std::rint((expected - point.q[i]) / turn) : 0.0;
      point.q[i] += std::abs(turns) < 4503599627370496.0 ? turn * turns : 0.0;
    }
    return point;
  }

  /// Return the publisher of ~/`topic` with a name for each joint and part.
  std::unique_ptr<Publisher> publisher(
    const std::string & topic, const std::vector<std::string> & parts, int position, int velocity,
    int effort)
  {
    auto made = std::make_unique<Publisher>(
      get_node()->create_publisher<JointState>("~/" + topic, rclcpp::SystemDefaultsQoS()));
    for (const auto & part : parts) {
      for (const auto & joint : JOINTS) {
        made->msg_.name.push_back(joint + part);
      }
    }
    made->msg_.position.resize(position);
    made->msg_.velocity.resize(velocity);
    made->msg_.effort.resize(effort);
    return made;
  }

  /// Publish the terms as the node `controller` does. A busy publisher skips a sample.
  void publish(const rclcpp::Time & time)
  {
    const auto row = [this](int k, int i) { return ctc_terms(&law_)[k * N + i]; };
    const auto send = [&time](Publisher & publisher, const auto & fill) {
        if (publisher.trylock()) {
          publisher.msg_.header.stamp = time;
          fill(publisher.msg_);
          publisher.unlockAndPublish();
        }
      };
    send(*tracking_, [&](auto & message) {
      for (int i = 0; i < N; ++i) {
        message.position[i] = q_d_[i];
        message.position[N + i] = row(CTC_E, i);
        message.velocity[i] = dq_d_[i];
        message.velocity[N + i] = row(CTC_DE, i);
      }
    });
    send(*filter_, [&](auto & message) {
      for (int i = 0; i < N; ++i) {
        message.velocity[i] = row(CTC_V, i);
      }
    });
    send(*torques_, [&](auto & message) {
      for (int i = 0; i < N; ++i) {
        message.effort[i] = row(CTC_NOMINAL, i);
        message.effort[N + i] = -row(CTC_COMPENSATION, i);
        message.effort[2 * N + i] = -row(CTC_ROBUST, i);
        message.effort[3 * N + i] = row(CTC_TAU, i);
      }
      message.effort[4 * N] = ctc_lyapunov(&law_);
    });
  }

  ctc_law law_;
  std::array<double, N> q_, dq_;
  std::array<double, CTC_POINTS * N> q_d_, dq_d_, ddq_d_;
  int64_t grace_ = 0, decimation_ = 1, samples_ = 0, updated_ = 0;
  std::atomic<int64_t> now_ = 0;
  std::atomic<int> activation_ = 0;
  /// Gains of the parameters, also in the buffer for the update.
  Gains set_gains_;
  realtime_tools::RealtimeBuffer<Gains> gains_;
  /// Gains of the law.
  Gains gains_in_force_;
  /// Reference points, also in the buffer for the update.
  Reference kept_;
  realtime_tools::RealtimeBuffer<Reference> reference_;
  rclcpp::Subscription<JointTrajectory>::SharedPtr subscription_;
  rclcpp::node_interfaces::OnSetParametersCallbackHandle::SharedPtr on_set_;
  std::unique_ptr<Publisher> tracking_, filter_, torques_;
};
}  // namespace @PACKAGE@_controller

PLUGINLIB_EXPORT_CLASS(@PACKAGE@_controller::Controller, controller_interface::ControllerInterface)
