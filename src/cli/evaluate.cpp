#include <algorithm>
#include <cmath>
#include <memory>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "measurements.hpp"
#include "output.hpp"

namespace helix_arm::cli {

namespace {

using nlohmann::json;

// RMS distance of the model's tags from those measured that fit one shape; nothing of none [m].
std::optional<double> tagDistance(const io::Scene& scene, const FittedCapture& capture) {
  const std::vector<lie::SE3> model = estimation::tagPoses(*scene.tags, capture.model.shape);
  const std::vector<int> outliers = capture.outlierTags(*scene.tags);
  double square = 0;
  int count = 0;
  for (const estimation::PoseObservation& seen : capture.seen) {
    const int id = scene.tags->tags[seen.tag].id;
    if (std::find(outliers.begin(), outliers.end(), id) != outliers.end()) continue;
    square += (model[seen.tag].translation - seen.X_BT.translation).squaredNorm();
    ++count;
  }
  return count > 0 ? std::optional(std::sqrt(square / count)) : std::nullopt;
}

json comparisonOf(const io::Scene& scene, const std::vector<FittedCapture>& fitted) {
  double arm_length = 0;  // at rest [m]
  for (int k = 0; k < scene.arm.sectionCount(); ++k) arm_length += scene.arm.restLength(k);
  const auto percent = [arm_length](const std::optional<double>& error) {
    return error ? json(100 * *error / arm_length) : json();
  };
  json captures = json::array();
  std::vector<double> rms, tip_errors;  // of the valid captures [m]
  for (const FittedCapture& capture : fitted) {
    std::optional<double> tags, tip;
    if (capture.model.converged() && capture.converged()) {
      tags = tagDistance(scene, capture);
      tip = (capture.model.tip.translation - measuredTip(*capture.fit).translation).norm();
      if (capture.sound()) rms.push_back(*tags);
      if (capture.sound()) tip_errors.push_back(*tip);
    }
    captures.push_back(captureJson(capture, *scene.tags));
    captures.back().update({{"rms_m", toJson(tags)},
                            {"tip_error_m", toJson(tip)},
                            {"tip_error_percent", percent(tip)},
                            {"fit_rms_m", capture.fit ? json(capture.fit->rms) : json()},
                            {"usual_fit_rms_m", toJson(capture.usual_rms)}});
  }
  const std::optional<double> tip_error = median(tip_errors);
  std::string reason = reasonForNoFit(fitted);
  if (reason.empty() && !tip_error) {
    const auto lacking =
        std::find_if(fitted.begin(), fitted.end(),
                     [](const FittedCapture& capture) { return !capture.model.converged(); });
    reason = "the model finds no shape for any valid capture: " +
             reasonForNoShape(lacking->model.status);
  }
  return {{"scene", scene.name},
          {"tier", statics::nameOf(scene.model.choice().setting.tier)},
          {"captures", captures},
          {"median_rms_m", toJson(median(rms))},
          {"median_tip_error_percent", percent(tip_error)},
          {"arm_length_m", arm_length},
          {"reason", textOrNull(reason)}};
}

// Compares the model's tags and tip with measured tag poses, and prints it. @return the exit code.
// @throws as fitCaptures() does, and io::DocumentError with every pressure outside the limits.
int evaluateTags(const io::Scene& scene, const io::DataSet& data, Format format) {
  procedures::pressuresWithinLimits(data, scene.arm);
  const std::vector<FittedCapture> captures = fitCaptures(scene, data);
  const json report = comparisonOf(scene, captures);
  json shown = without(report, {"converged", "usual_fit_rms_m"});
  for (const FittedCapture& capture : captures) {
    if (capture.usual_rms) shown["notes"].push_back(noteOnScatter(capture));
    if (capture.model.converged()) continue;
    shown["notes"].push_back("capture " + std::to_string(capture.number) + ": " +
                             reasonForNoShape(capture.model.status));
  }
  const auto table = [&report] {
    printComments(report, {"median_rms_m", "median_tip_error_percent"});
    printReason(report);
    return CsvTable(report["captures"],
                    {"capture", "status", "pressure_pa", "rms_m", "tip_error_m",
                     "tip_error_percent", "outlier_tags", "unknown_tags", "model_status"});
  };
  printResult(format, report, table, shown);
  return report["reason"].is_null() ? kDone : kNotPossible;
}

struct EvaluateOptions {
  std::string scene, data;
};

void requireComparable(const io::Scene& scene, const io::DataSet& data) {
  if (data.find("curvature_rad") < 0) {
    throw CallerError(data.path +
                      " has no measurements to compare with; expected the columns pressure_1_kpa "
                      ".. and curvature_rad, or tag poses");
  }
  requirePressureDriven(scene);
  if (scene.arm.sectionCount() != 1) {
    throw CallerError("curvature_rad applies to arms of one section; scene " + scene.name +
                      " has " + std::to_string(scene.arm.sectionCount()));
  }
}

// Length-scaled curvature of every row: |(w_y, w_z)| of the section.
int evaluateCurvature(const io::Scene& scene, const io::DataSet& data, Format format) {
  requireComparable(scene, data);
  const Eigen::MatrixXd pressures = procedures::pressuresWithinLimits(data, scene.arm);
  const Eigen::VectorXd measured = data.values.col(data.find("curvature_rad"));
  json points = json::array(), reason;
  double square = 0, most = 0;
  int count = 0;
  for (Eigen::Index row = 0; row < pressures.rows(); ++row) {
    const statics::Solution solution = scene.model.solve(pressures.row(row));
    json model, difference;
    if (solution.converged()) {
      const double curvature = model::curvatureOf(solution.shape.twists().col(0));
      const double off = curvature - measured[row];
      model = curvature;
      difference = off;
      square += off * off;
      most = std::max(most, std::abs(off));
      ++count;
    } else if (reason.is_null()) {
      reason = "row " + std::to_string(row + 1) + ": " + reasonForNoShape(solution.status);
    }
    points.push_back({{"pressure_pa", toJson(pressures.row(row))},
                      {"measured_rad", measured[row]},
                      {"model_rad", model},
                      {"difference_rad", difference}});
  }
  const json report{{"scene", scene.name},
                    {"tier", statics::nameOf(scene.model.choice().setting.tier)},
                    {"rms_rad", count > 0 ? json(std::sqrt(square / count)) : json()},
                    {"max_rad", count > 0 ? json(most) : json()},
                    {"reason", reason},
                    {"points", without(points, {"difference_rad"})}};
  json shown = report;
  shown["points"] = points;
  const auto table = [&] {
    printComments(report, {"rms_rad", "max_rad"});
    printReason(report);
    return CsvTable(points, {"pressure_pa", "measured_rad", "model_rad", "difference_rad"});
  };
  printResult(format, report, table, shown);
  return reason.is_null() ? kDone : kNotPossible;
}

int run(const EvaluateOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  const io::DataSet data = io::loadDataSet(options.data);
  const bool tags = data.find("curvature_rad") < 0 && data.find("tag") >= 0;
  return tags ? evaluateTags(scene, data, global.format)
              : evaluateCurvature(scene, data, global.format);
}

}  // namespace

Subcommand addEvaluate(CLI::App& app) {
  CLI::App* command = app.add_subcommand("evaluate", "compare the model with measurements");
  const auto options = std::make_shared<EvaluateOptions>();
  addScene(*command, "SCENE", options->scene, "scene file")->required();
  addOption(
      *command, "DATA", options->data,
      "data set (# comments, a header, rows) with the columns pressure_1_kpa .. (gauge; a missing "
      "one is 0) and curvature_rad (length-scaled curvature), or the tag poses that fit takes",
      kRequired);
  command->footer(R"(Curvature, json: rms_rad and max_rad of model - measured, points [{pressure_pa,
measured_rad, model_rad}], tier, reason (if the model finds no shape under its load:
model_rad is null there, exit code 1).
Tag poses, json: captures [{capture, pressure_pa, status (of the fit), converged,
reason, model_status (as that of forward), rms_m (the model's tags against those
measured that fit one shape), tip_error_m and tip_error_percent (model against fitted
tip, of the arm's length at rest), outlier_tags, fit_rms_m, usual_fit_rms_m (only where
fit_rms_m is far larger than that of the others), unknown_tags}], median_rms_m and
median_tip_error_percent over the captures whose tags all fit, arm_length_m, tier,
reason.
csv: the summary as # comments, then one row per point or capture.)");
  return {command, [options](const GlobalOptions& global) { return run(*options, global); }};
}

}  // namespace helix_arm::cli
