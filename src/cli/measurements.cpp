#include "measurements.hpp"

#include <algorithm>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/basics/median.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/captures.hpp"

namespace helix_arm::cli {
namespace {

// What forward and inverse print besides numbers, so that each reads what the other printed.
const std::vector<std::string> kPrinted = {"tier",      "order",         "status",
                                           "converged", "active_limits", "tip_error_percent"};

std::string reasonOf(const io::Scene& scene, const FittedCapture& capture) {
  const std::string check =
      "; check that their positions are in metres and seen from the arm's base, and where the "
      "scene places the tags";
  switch (capture.status) {
    case estimation::FitStatus::kConverged:
      return {};
    case estimation::FitStatus::kNotConverged:
      return "the fit of a shape to its tags did not converge" + check;
    case estimation::FitStatus::kUnexplained:
      return "no shape of the arm fits more than half of its tags" + check;
    case estimation::FitStatus::kUnderdetermined:
      break;
  }
  std::vector<int> tags;
  for (const estimation::PoseObservation& seen : capture.seen) tags.push_back(seen.tag);
  // Three points determine a section's twist, two in a plane; one pose counts as all of them.
  const int places = scene.vision.fit.planar ? 2 : 3;
  return whyUndetermined(scene, tags, scene.vision.fit.rotation_noise > 0 ? 1 : places);
}

void compareScatter(bool planar, std::vector<FittedCapture>& captures) {
  std::vector<std::optional<estimation::CaptureScatter>> scatter;
  for (const FittedCapture& capture : captures) {
    scatter.emplace_back();
    if (capture.converged()) scatter.back() = procedures::scatterOfPoses(*capture.fit, planar);
  }
  const estimation::CaptureCheck check = estimation::checkCaptures(scatter);
  for (std::size_t i = 0; i < captures.size(); ++i) {
    if (check.apart[i]) captures[i].usual_rms = check.usual;
  }
}

Eigen::VectorXd halfWidths(const model::Arm& arm) {
  Eigen::VectorXd out(arm.actuatorCount());
  for (int i = 0; i < out.size(); ++i) out[i] = arm.actuator(i).response.halfWidth();
  return out;
}

}  // namespace

void requirePressureDriven(const io::Scene& scene) {
  if (!hasTendon(scene.arm)) return;
  throw CallerError("scene " + scene.name +
                    " has tendons, but the data set gives pressures; expected a scene whose "
                    "actuators are all driven by pressure");
}

std::string reasonForNoShape(statics::SolveStatus status) {
  if (status == statics::SolveStatus::kUnsupported) {
    return "the load pulls along a motion that no actuator resists";
  }
  if (status == statics::SolveStatus::kSnapped) {
    return "the shapes that grow from the unloaded one end at a smaller load, and the arm may snap "
           "to several others; lower the load, or raise arm.stiffness.K_eps_n";
  }
  return "no shape that balances the load was found within the error that the tier states; less "
         "load, a higher order or tier: exact may help";
}

std::string noteOnStart(const statics::Solution& solution) {
  if (solution.converged()) return {};
  return "the search began at the shape without load: " + reasonForNoShape(solution.status);
}

std::vector<int> FittedCapture::outlierTags(const estimation::TagLayout& layout) const {
  std::vector<int> ids;
  if (!fit) return ids;
  for (const estimation::TagResidual& tag : fit->tags) {
    if (tag.outlier) ids.push_back(layout.tags[tag.tag].id);
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

std::vector<FittedCapture> fitCaptures(const io::Scene& scene, const io::DataSet& data) {
  if (!scene.tags) {
    throw CallerError(data.path + " holds tag poses, but scene " + scene.name +
                      " has no tags; expected a scene with a section tags");
  }
  requirePressureDriven(scene);
  estimation::TwistFitter fitter(*scene.tags, scene.arm.sectionCount(), scene.vision.fit);
  std::vector<FittedCapture> captures;
  for (const io::TagPoseCapture& measured :
       io::loadTagPoses(data, scene.arm.actuatorCount(), scene.X_BF)) {
    FittedCapture capture{measured.number, measured.pressure, {}, {}, {}, {}, {}, {}, {}};
    for (const io::TagPose& tag : measured.tags) {
      const int index = scene.tags->find(tag.id);
      if (index < 0) {
        capture.unknown_tags.push_back(tag.id);
      } else {
        capture.seen.push_back({index, tag.X_BT});
      }
    }
    const Eigen::VectorXd pressure = scene.arm.clamped(measured.pressure);
    capture.model = scene.model.solve(pressure);
    const estimation::TwistFit& fit =
        fitter.fitCold(capture.seen, statics::startingShape(scene.model, capture.model, pressure));
    capture.status = fit.status;
    capture.reason = reasonOf(scene, capture);
    if (fit.status == estimation::FitStatus::kConverged ||
        fit.status == estimation::FitStatus::kNotConverged) {
      capture.fit = fit;
    }
    captures.push_back(std::move(capture));
  }
  compareScatter(scene.vision.fit.planar, captures);
  return captures;
}

nlohmann::json captureJson(const FittedCapture& capture, const estimation::TagLayout& layout) {
  return {{"capture", capture.number},
          {"pressure_pa", toJson(capture.pressure)},
          {"status", estimation::nameOf(capture.status)},
          {"converged", capture.converged()},
          {"reason", textOrNull(capture.reason)},
          {"model_status", statics::nameOf(capture.model.status)},
          {"outlier_tags", capture.outlierTags(layout)},
          {"unknown_tags", capture.unknown_tags}};
}

std::string noteOnScatter(const FittedCapture& capture) {
  if (!capture.usual_rms) return {};
  return procedures::scatterText(capture.fit->rms, *capture.usual_rms);
}

lie::SE3 measuredTip(const estimation::TwistFit& fit) {
  return fit.X_B0B * model::tipPose(fit.shape);
}

std::string reasonForNoFit(const std::vector<FittedCapture>& captures) {
  const auto any = [&captures](auto holds) {
    return std::any_of(captures.begin(), captures.end(), holds);
  };
  if (any([](const FittedCapture& capture) { return capture.sound(); })) return {};
  if (any([](const FittedCapture& capture) { return capture.converged(); })) {
    return "no capture is valid: each that could be fitted has tags that do not fit";
  }
  // The most frequent reason.
  std::map<std::string, int> counts;
  for (const FittedCapture& capture : captures) ++counts[capture.reason];
  const auto most =
      std::max_element(counts.begin(), counts.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  return "no capture could be fitted; " + std::to_string(most->second) + " of " +
         std::to_string(captures.size()) + ": " + most->first;
}

std::string whyUndetermined(const io::Scene& scene, const std::vector<int>& tags, int needed) {
  std::vector<int> counts(scene.looks.size());
  for (const int tag : tags) ++counts[scene.tags->tags[tag].section];
  std::string lacking;
  for (std::size_t k = 0; k < counts.size(); ++k) {
    if (counts[k] >= needed) continue;
    lacking += (lacking.empty() ? "" : ", ") + ("section " + scene.looks[k].name) + " has " +
               std::to_string(counts[k]) + (counts[k] == 1 ? " tag" : " tags") + " in sight";
  }
  if (!lacking.empty()) return lacking + "; expected at least " + std::to_string(needed);
  return "the visible tags do not determine the arm's shape; place tags farther apart and on "
         "different sides of the arm";
}

std::optional<double> median(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  return basics::medianOf(std::move(values));
}

model::InputHistory historyOfFile(const io::Scene& scene, const std::string& path) {
  requirePressureDriven(scene);
  return io::historyOf(io::loadDataSet(path), scene.arm.actuatorCount());
}

std::string noteOnResponse(const model::Arm& arm) {
  if (model::ArmResponse(arm).instant()) return {};
  const double widest = halfWidths(arm).maxCoeff();
  return "at rest, with every effective pressure the pressure itself" +
         (widest > 0
              ? basics::format(": the middle of hysteresis loops of up to +-%g kPa", 1e-3 * widest)
              : "");
}

void addResponse(const model::Arm& arm, const model::ArmResponse& response, Eigen::Index rows,
                 nlohmann::json& result) {
  if (response.instant()) return;
  nlohmann::json& out = result["response"];
  out["history_rows"] = rows;
  out["memory_known"] = rows > 0 && response.known();
  out["half_width_pa"] = toJson(halfWidths(arm));
  out["uncertainty_pa"] = toJson(response.uncertainty());
  out["note"] = rows > 0 ? nlohmann::json() : nlohmann::json(noteOnResponse(arm));
}

io::DataSet tableOf(const std::string& path) {
  return path == "-" ? io::readDataSet(std::cin, "stdin", kPrinted)
                     : io::loadDataSet(path, kPrinted);
}

std::vector<std::string> poseColumns(const io::DataSet& data) {
  const bool printed = data.find("x_m") < 0 && data.find("tip_x_m") >= 0;
  const std::string prefix = printed ? "tip_" : "";
  std::vector<std::string> names;
  for (const char* name : {"x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"}) {
    if (names.size() < 3 || data.find(prefix + "qx") >= 0) names.push_back(prefix + name);
  }
  return names;
}

Eigen::MatrixXd columnsOf(const io::DataSet& data, const std::vector<std::string>& names) {
  Eigen::MatrixXd out(data.values.rows(), static_cast<Eigen::Index>(names.size()));
  std::string missing;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const int column = data.find(names[i]);
    if (column < 0) {
      missing += (missing.empty() ? "" : ", ") + names[i];
    } else {
      out.col(static_cast<Eigen::Index>(i)) = data.values.col(column);
    }
  }
  if (!missing.empty()) throw CallerError(data.path + " has no column " + missing);
  return out;
}

Eigen::MatrixXd inputRowsOf(const io::Scene& scene, const io::DataSet& data) {
  const model::Arm& arm = scene.arm;
  std::vector<std::string> names;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const model::DriveUnit unit = model::unitOf(arm.actuator(i).drive);
    const std::string number = std::to_string(i + 1);
    names.push_back("input_" + number);
    const std::string printed = std::string(unit.quantity) + "_" + number + "_" + unit.si_suffix;
    if (hasTendon(arm) && data.find(printed) >= 0) names.back() = printed;
  }
  const bool in_si = hasTendon(arm) || data.find(names.front()) >= 0;
  Eigen::MatrixXd inputs =
      in_si ? columnsOf(data, names) : io::pressuresOf(data, arm.actuatorCount());
  for (Eigen::Index row = 0; row < inputs.rows(); ++row) {
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      const model::Actuator& actuator = arm.actuator(i);
      if (actuator.limits.contains(inputs(row, i))) continue;
      throw CallerError(data.path + ":" +
                        std::to_string(data.lines[static_cast<std::size_t>(row)]) +
                        " is beyond the limits of " + actuator.name + ": " +
                        inputText(actuator, actuator.limits.lower) + " to " +
                        inputText(actuator, actuator.limits.upper));
    }
  }
  if (in_si || data.find("pressure_1_pa") >= 0) warnOfKilopascals(data.path, arm, inputs);
  return inputs;
}

}  // namespace helix_arm::cli
