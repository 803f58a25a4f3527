// Tells in words how a measurement goes and what its largest errors are.
//
// An example for nodes of your own that use results:
//
//   ros2 run stepdiag_results_cpp watch_results
//   ros2 run stepdiag_results_cpp watch_results --ros-args -r __ns:=/cell

#include <cmath>
#include <cstddef>
#include <iomanip>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "rclcpp/rclcpp.hpp"
#include "stepdiag_ros/msg/diagnosis.hpp"
#include "stepdiag_ros/msg/run_state.hpp"
#include "stepdiag_ros/msg/volumetric_errors.hpp"

namespace
{

using stepdiag_ros::msg::Diagnosis;
using stepdiag_ros::msg::RunState;
using stepdiag_ros::msg::VolumetricErrors;

// One error over the travel of one axis, with its standard uncertainty (m or rad).
struct Curve
{
  std::string name;
  std::string axis;
  const std::vector<double> & places;
  const std::vector<double> & values;
  const std::vector<double> & uncertainties;
};

std::vector<Curve> displacements(const VolumetricErrors & e)
{
  return {
    {"E_XX", "X", e.x, e.e_xx, e.u_e_xx}, {"E_YX", "X", e.x, e.e_yx, e.u_e_yx},
    {"E_ZX", "X", e.x, e.e_zx, e.u_e_zx}, {"E_XY", "Y", e.y, e.e_xy, e.u_e_xy},
    {"E_YY", "Y", e.y, e.e_yy, e.u_e_yy}, {"E_ZY", "Y", e.y, e.e_zy, e.u_e_zy},
    {"E_XZ", "Z", e.z, e.e_xz, e.u_e_xz}, {"E_YZ", "Z", e.z, e.e_yz, e.u_e_yz},
    {"E_ZZ", "Z", e.z, e.e_zz, e.u_e_zz},
  };
}

std::vector<Curve> rotations(const VolumetricErrors & e)
{
  return {
    {"E_AX", "X", e.x, e.e_ax, e.u_e_ax}, {"E_BX", "X", e.x, e.e_bx, e.u_e_bx},
    {"E_CX", "X", e.x, e.e_cx, e.u_e_cx}, {"E_AY", "Y", e.y, e.e_ay, e.u_e_ay},
    {"E_BY", "Y", e.y, e.e_by, e.u_e_by}, {"E_CY", "Y", e.y, e.e_cy, e.u_e_cy},
    {"E_AZ", "Z", e.z, e.e_az, e.u_e_az}, {"E_BZ", "Z", e.z, e.e_bz, e.u_e_bz},
    {"E_CZ", "Z", e.z, e.e_cz, e.u_e_cz},
  };
}

// The largest error of one kind in words; empty if the method has none of that kind.
std::string largest(
  const std::vector<Curve> & curves, const std::string & kind, const std::string & unit)
{
  constexpr double kMicro = 1e6;  // m to µm, rad to µrad
  const Curve * worst = nullptr;
  std::size_t at = 0;
  bool estimated = false;
  for (const Curve & curve : curves) {
    estimated = estimated || !curve.values.empty();
    // Zero at the first place by definition.
    for (std::size_t i = 1; i < curve.values.size(); ++i) {
      if (!std::isfinite(curve.values[i])) {
        continue;  // NaN: these lines cannot tell it
      }
      if (worst == nullptr || std::abs(curve.values[i]) > std::abs(worst->values[at])) {
        worst = &curve;
        at = i;
      }
    }
  }
  if (worst == nullptr) {
    return estimated ? "no " + kind + " is known" : "";
  }
  std::ostringstream text;
  text << std::fixed << std::setprecision(2) << "largest " << kind << " " << worst->name << " = "
       << worst->values[at] * kMicro << " " << unit << " at " << worst->axis << " = "
       << std::setprecision(1) << worst->places.at(at) * 1e3 << " mm (" << std::setprecision(2);
  const double u = worst->uncertainties.at(at);
  if (std::isfinite(u)) {
    text << "standard uncertainty " << u * kMicro << " " << unit << ")";
  } else {
    text << "u unknown)";
  }
  return text.str();
}

std::string in_words(const RunState & state)
{
  switch (state.state) {
    case RunState::STATE_IDLE: return "idle";
    case RunState::STATE_RUNNING: return "measures " + state.line;
    case RunState::STATE_PAUSED: return "paused";
    case RunState::STATE_WAITING_FOR_SETUP: return "waits for laser and mirror to be set up";
    case RunState::STATE_FINISHED: return "finished";
    case RunState::STATE_ABORTED: return "aborted";
    case RunState::STATE_FAULT: return "stopped by a fault";
    default: return "in an unknown state";
  }
}

class WatchResults : public rclcpp::Node
{
public:
  WatchResults()
  : Node("watch_results")
  {
    // What holds until something newer is said. A subscriber that asks for less, for example the
    // default of ROS 2, would miss what was said before it came, until that is repeated.
    const auto latched = rclcpp::QoS(rclcpp::KeepLast(20)).reliable().transient_local();
    // Relative names: the node finds the measurement of its own namespace.
    state_ = create_subscription<RunState>(
      "run/state", latched, [this](const RunState & m) {on_state(m);});
    errors_ = create_subscription<VolumetricErrors>(
      "result/volumetric_errors", latched, [this](const VolumetricErrors & m) {on_errors(m);});
    diagnosis_ = create_subscription<Diagnosis>(
      "result/diagnosis", latched, [this](const Diagnosis & m) {on_diagnosis(m);});
  }

private:
  void on_state(const RunState & state)
  {
    std::string text = "run " + (state.run_id.empty() ? "-" : state.run_id) + ": ";
    text += in_words(state);
    if (state.state != RunState::STATE_RUNNING && !state.text.empty()) {
      text += ": " + state.text;
    }
    say("state", text);
  }

  // Each method speaks for itself; a line gives the first result, each further line a better one.
  void on_errors(const VolumetricErrors & errors)
  {
    std::string text = errors.method + ", " + std::to_string(errors.lines) + " lines: ";
    text += largest(displacements(errors), "displacement", "µm");
    const std::string rotation = largest(rotations(errors), "rotation", "µrad");
    text += rotation.empty() ? "" : "; " + rotation;
    for (std::size_t i = 0; i < errors.not_determined.size(); ++i) {
      const std::string & reason = errors.not_determined[i];
      // The names alone; the reason stands behind the colon.
      text += (i == 0 ? "; not wholly determined: " : ", ") + reason.substr(0, reason.find(':'));
    }
    say(errors.method, text);
  }

  void on_diagnosis(const Diagnosis & diagnosis)
  {
    std::string text = "diagnosis";
    if (!diagnosis.run_over) {
      text += ", after " + std::to_string(diagnosis.lines) + " lines";
    }
    say("diagnosis", text + ": " + diagnosis.verdict + ": " + diagnosis.sentence);
  }

  // Prints what is news: states and results are repeated for late listeners.
  void say(const std::string & about, const std::string & text)
  {
    std::string & said = said_[about];
    if (said != text) {
      said = text;
      std::cout << text << std::endl;
    }
  }

  std::map<std::string, std::string> said_;
  rclcpp::Subscription<RunState>::SharedPtr state_;
  rclcpp::Subscription<VolumetricErrors>::SharedPtr errors_;
  rclcpp::Subscription<Diagnosis>::SharedPtr diagnosis_;
};

}  // namespace

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<WatchResults>());
  rclcpp::shutdown();
  return 0;
}
