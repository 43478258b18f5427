#include <algorithm>
#include <cmath>
#include <utility>

#include "fault_hypotheses.hpp"
#include "helix_arm/basics/text.hpp"

namespace helix_arm::estimation {
namespace {

// Muscles of one batch bend as if their pressures differed by some 10 %, and sensors that were
// zeroed once are off by as much as regulators: neither is a mistake.
constexpr double kLeastGain = 0.12, kLeastOffset = 12e3;  // [Pa]

FaultHypothesis exchanged(const Eigen::VectorXi& from, const std::string& subject) {
  return {"channels_exchanged", subject,
          always("exchange the hoses at the regulator, or their channels in the scene"),
          [from](double, Eigen::MatrixXd& read) { read = read(Eigen::all, from).eval(); }};
}

void addExchanges(const model::Arm& arm, std::vector<FaultHypothesis>& out) {
  const int all = arm.actuatorCount();
  const Eigen::VectorXi same = Eigen::VectorXi::LinSpaced(all, 0, all - 1);
  for (int i = 0; i < all; ++i) {
    for (int j = i + 1; j < all; ++j) {
      Eigen::VectorXi from = same;
      std::swap(from[i], from[j]);
      out.push_back(exchanged(from, arm.actuator(i).name + " and " + arm.actuator(j).name));
    }
  }
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const int first = arm.firstActuator(k), next = arm.firstActuator(k + 1), count = next - first;
    for (int turn = 1; turn < count && count > 2; ++turn) {
      Eigen::VectorXi from = same;
      std::vector<std::string> names;
      for (int i = 0; i < count; ++i) {
        from[first + i] = first + (i + turn) % count;
        names.push_back(arm.actuator(from[first + i]).name);
      }
      out.push_back(
          exchanged(from, messageOf("section ", k + 1, ", in the order ", basics::joined(names))));
    }
    if (k + 1 < arm.sectionCount() && arm.firstActuator(k + 2) - next == count && count > 1) {
      Eigen::VectorXi from = same;
      from.segment(first, count).swap(from.segment(next, count));
      out.push_back(exchanged(from, messageOf("sections ", k + 1, " and ", k + 2)));
    }
  }
}

void addUnits(std::vector<FaultHypothesis>& out) {
  // Factors on what was read as kPa; of the last one, as psi.
  static constexpr std::pair<const char*, double> kUnits[] = {{"psi", 6.894757},
                                                              {"bar", 100.0},
                                                              {"mbar", 0.1},
                                                              {"Pa", 1e-3},
                                                              {"kPa instead of psi", 1 / 6.894757}};
  for (const auto& [unit, factor] : kUnits) {
    out.push_back({"pressure_unit", messageOf("all channels in ", unit),
                   always(messageOf("the pressures are in ", unit,
                                    ": convert them, and name their unit in the header")),
                   [factor = factor](double, Eigen::MatrixXd& read) { read *= factor; }});
  }
}

// @param channel  -1: the same gain or offset of all.
void addChannel(const model::Arm& arm, int channel, std::vector<FaultHypothesis>& out) {
  const bool all = channel < 0;
  const int first = std::max(channel, 0), count = all ? arm.actuatorCount() : 1;
  const std::string subject = all ? "all channels" : arm.actuator(channel).name;
  double range = 0;
  for (int i = first; i < first + count; ++i) {
    range = std::max(range, arm.actuator(i).limits.upper - arm.actuator(i).limits.lower);
  }
  const auto scaled = [](double size, const Calibration&) {
    return messageOf(
        "the pressure in the muscle is ", std::round(100 * size),
        " % of what is read: look for a leak, and check the scale of the sensor and of "
        "the regulator");
  };
  out.push_back({"pressure_gain", subject, scaled, [first, count](double size, auto& read) {
                   read.middleCols(first, count) *= size;
                 }});
  // From a muscle that leaks most of its pressure to a regulator of three times the range.
  out.back().size = {{0.35, 0.5, 0.7, 0.9, 1.15, 1.4, 2.0, 2.8}, 1.0, kLeastGain};
  out.back().of_all = all;
  const auto shifted = [range](double part, const Calibration&) {
    return messageOf("the pressure in the muscle is ", std::round(std::abs(part * range) / 1e3),
                     " kPa ", part > 0 ? "above" : "below",
                     " what is read: zero the sensor with the muscle vented");
  };
  out.push_back(
      {"pressure_offset", subject, shifted, [first, count, range](double part, auto& read) {
         read.middleCols(first, count).array() += part * range;
       }});
  out.back().size = {{-0.2, -0.1, -0.05, 0.05, 0.1, 0.2}, 0.0, kLeastOffset / range};
  out.back().of_all = all;
  if (all) return;
  const double vented = std::max(0.0, arm.actuator(channel).limits.lower);
  out.push_back(
      {"channel_dead", subject,
       always("no pressure reaches the muscle: check its hose, its valve and its channel"),
       [channel, vented](double, Eigen::MatrixXd& read) {
         read.col(channel).setConstant(vented);
       }});
}

}  // namespace

std::vector<FaultHypothesis> pressureHypotheses(const model::Arm& arm) {
  std::vector<FaultHypothesis> out;
  addExchanges(arm, out);
  addUnits(out);
  for (int channel = -1; channel < arm.actuatorCount(); ++channel) addChannel(arm, channel, out);
  return out;
}

}  // namespace helix_arm::estimation
