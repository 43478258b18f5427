#include <algorithm>
#include <cmath>
#include <iomanip>
#include <iostream>
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

// The model's tags and tip against those of one capture.
struct CaptureComparison {
  FittedCapture measured;
  std::vector<int> outlier_tags;
  std::optional<double> rms;        // of the tags that fit the measured shape [m]
  std::optional<double> tip_error;  // [m]
};

struct TagComparison {
  std::vector<CaptureComparison> captures;
  double arm_length;                                   // at rest [m]
  std::optional<double> median_rms, median_tip_error;  // over the valid captures [m]

  std::optional<double> percent(const std::optional<double>& tip_error) const {
    return tip_error ? std::optional(100 * *tip_error / arm_length) : std::nullopt;
  }
};

CaptureComparison compareCapture(const io::Scene& scene, FittedCapture measured) {
  CaptureComparison comparison{std::move(measured), {}, {}, {}};
  const FittedCapture& capture = comparison.measured;
  comparison.outlier_tags = capture.outlierTags(*scene.tags);
  if (!capture.model.converged()) return comparison;
  const std::vector<lie::SE3> model = estimation::tagPoses(*scene.tags, capture.model.shape);
  double square = 0;
  int count = 0;
  for (const estimation::PoseObservation& seen : capture.seen) {
    const int id = scene.tags->tags[seen.tag].id;
    const std::vector<int>& outliers = comparison.outlier_tags;
    if (std::find(outliers.begin(), outliers.end(), id) != outliers.end()) continue;
    square += (model[seen.tag].translation - seen.X_BT.translation).squaredNorm();
    ++count;
  }
  if (capture.converged()) {
    if (count > 0) comparison.rms = std::sqrt(square / count);
    comparison.tip_error =
        (capture.model.tip.translation - measuredTip(*capture.fit).translation).norm();
  }
  return comparison;
}

TagComparison compareTags(const io::Scene& scene, const io::DataSet& data) {
  TagComparison comparison{{}, 0, {}, {}};
  for (int k = 0; k < scene.arm.sectionCount(); ++k) {
    comparison.arm_length += scene.arm.restLength(k);
  }
  std::vector<double> rms, tip_errors;
  for (FittedCapture& measured : fitCaptures(scene, data)) {
    comparison.captures.push_back(compareCapture(scene, std::move(measured)));
    const CaptureComparison& capture = comparison.captures.back();
    if (!capture.measured.sound() || !capture.tip_error) continue;
    rms.push_back(*capture.rms);
    tip_errors.push_back(*capture.tip_error);
  }
  comparison.median_rms = median(std::move(rms));
  comparison.median_tip_error = median(std::move(tip_errors));
  return comparison;
}

std::vector<FittedCapture> fittedOf(const TagComparison& c) {
  std::vector<FittedCapture> captures;
  for (const CaptureComparison& capture : c.captures) captures.push_back(capture.measured);
  return captures;
}

// Empty if the model has a shape for at least one valid capture.
std::string reasonForNoModel(const TagComparison& c) {
  if (c.median_tip_error) return {};
  const auto lacking = std::find_if(c.captures.begin(), c.captures.end(), [](const auto& capture) {
    return !capture.measured.model.converged();
  });
  return "the model finds no shape for any valid capture: " +
         reasonForNoShape(lacking->measured.model.status);
}

json reportOf(const io::Scene& scene, const TagComparison& c, const std::string& reason) {
  json captures = json::array();
  for (const CaptureComparison& capture : c.captures) {
    captures.push_back(
        {{"capture", capture.measured.number},
         {"pressure_pa", toJson(capture.measured.pressure)},
         {"status", estimation::nameOf(capture.measured.status)},
         {"converged", capture.measured.converged()},
         {"reason", textOrNull(capture.measured.reason)},
         {"model_status", statics::nameOf(capture.measured.model.status)},
         {"rms_m", toJson(capture.rms)},
         {"tip_error_m", toJson(capture.tip_error)},
         {"tip_error_percent", toJson(c.percent(capture.tip_error))},
         {"outlier_tags", capture.outlier_tags},
         {"fit_rms_m", capture.measured.fit ? json(capture.measured.fit->rms) : json()},
         {"usual_fit_rms_m", toJson(capture.measured.usual_rms)},
         {"unknown_tags", capture.measured.unknown_tags}});
  }
  return {{"scene", scene.name},
          {"tier", statics::nameOf(scene.model.choice().setting.tier)},
          {"captures", captures},
          {"median_rms_m", toJson(c.median_rms)},
          {"median_tip_error_percent", toJson(c.percent(c.median_tip_error))},
          {"arm_length_m", c.arm_length},
          {"reason", textOrNull(reason)}};
}

// The table, after comments that are printed at once.
CsvTable csvTable(const TagComparison& c, const json& report, const std::string& reason) {
  std::cout << "# median_rms_m " << exact(c.median_rms) << "\n# median_tip_error_percent "
            << exact(c.percent(c.median_tip_error)) << "\n";
  if (!reason.empty()) std::cout << "# reason " << reason << "\n";
  return {report["captures"],
          {"capture", "status", "pressure_pa", "rms_m", "tip_error_m", "tip_error_percent",
           "outlier_tags", "unknown_tags", "model_status"}};
}

// The report with what it means.
json shownOf(const TagComparison& c, const json& report) {
  json shown = without(report, {"converged", "usual_fit_rms_m"});
  for (const CaptureComparison& capture : c.captures) {
    const FittedCapture& measured = capture.measured;
    if (measured.usual_rms) shown["notes"].push_back(noteOnScatter(measured));
    if (measured.model.converged()) continue;
    shown["notes"].push_back("capture " + std::to_string(measured.number) + ": " +
                             reasonForNoShape(measured.model.status));
  }
  return shown;
}

// Compares the model's tags and tip with measured tag poses, and prints it. @return the exit code.
// @throws as fitCaptures() does, and io::DocumentError with every pressure outside the limits.
int evaluateTags(const io::Scene& scene, const io::DataSet& data, Format format) {
  procedures::pressuresWithinLimits(data, scene.arm);
  const TagComparison comparison = compareTags(scene, data);
  std::string reason = reasonForNoFit(fittedOf(comparison));
  if (reason.empty()) reason = reasonForNoModel(comparison);
  const json report = reportOf(scene, comparison, reason);
  printResult(
      format, report, [&] { return csvTable(comparison, report, reason); },
      shownOf(comparison, report));
  return reason.empty() ? kDone : kNotPossible;
}

struct EvaluateOptions {
  std::string scene, data;
};

// Length-scaled curvature of every row: |(w_y, w_z)| of the section.
struct CurvatureComparison {
  Eigen::MatrixXd pressures;  // (rows x actuators) [Pa]
  Eigen::VectorXd measured;
  std::vector<std::optional<double>> model;  // (rows) absent if it finds no shape
  std::string reason;                        // why some are absent
  std::optional<double> difference(int row) const {
    return model[row] ? std::optional(*model[row] - measured[row]) : std::nullopt;
  }
  // Over the rows that have a model; absent if none has.
  std::optional<double> rms() const {
    double sum = 0;
    int count = 0;
    for (int row = 0; row < measured.size(); ++row) {
      if (!model[row]) continue;
      sum += *difference(row) * *difference(row);
      ++count;
    }
    return count > 0 ? std::optional(std::sqrt(sum / count)) : std::nullopt;
  }
  std::optional<double> max() const {
    std::optional<double> most;
    for (int row = 0; row < measured.size(); ++row) {
      if (model[row]) most = std::max(most.value_or(0), std::abs(*difference(row)));
    }
    return most;
  }
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

CurvatureComparison compareCurvature(const io::Scene& scene, const io::DataSet& data) {
  CurvatureComparison comparison{procedures::pressuresWithinLimits(data, scene.arm),
                                 data.values.col(data.find("curvature_rad")),
                                 {},
                                 {}};
  for (int row = 0; row < comparison.pressures.rows(); ++row) {
    const statics::Solution solution = scene.model.solve(comparison.pressures.row(row));
    std::optional<double> curvature;
    if (solution.converged()) curvature = model::curvatureOf(solution.shape.twists().col(0));
    if (!curvature && comparison.reason.empty()) {
      comparison.reason =
          "row " + std::to_string(row + 1) + ": " + reasonForNoShape(solution.status);
    }
    comparison.model.push_back(curvature);
  }
  return comparison;
}

json reportOf(const io::Scene& scene, const CurvatureComparison& c) {
  json points = json::array();
  for (int row = 0; row < c.measured.size(); ++row) {
    points.push_back({{"pressure_pa", toJson(c.pressures.row(row))},
                      {"measured_rad", c.measured[row]},
                      {"model_rad", toJson(c.model[row])}});
  }
  return {{"scene", scene.name},
          {"tier", statics::nameOf(scene.model.choice().setting.tier)},
          {"rms_rad", toJson(c.rms())},
          {"max_rad", toJson(c.max())},
          {"reason", textOrNull(c.reason)},
          {"points", points}};
}

// The table, after comments that are printed at once.
CsvTable csvTable(const CurvatureComparison& c, const json& report) {
  std::cout << "# rms_rad " << exact(c.rms()) << "\n# max_rad " << exact(c.max()) << "\n";
  if (!c.reason.empty()) std::cout << "# reason " << c.reason << "\n";
  CsvTable table;
  for (int row = 0; row < c.measured.size(); ++row) {
    CsvTable::Row cells = cellsOf(report["points"][static_cast<std::size_t>(row)],
                                  {"pressure_pa", "measured_rad", "model_rad"});
    cells.emplace_back("difference_rad", exact(c.difference(row)));
    table.add(cells);
  }
  return table;
}

int evaluateCurvature(const io::Scene& scene, const io::DataSet& data, Format format) {
  requireComparable(scene, data);
  const CurvatureComparison comparison = compareCurvature(scene, data);
  const json report = reportOf(scene, comparison);
  json shown = report;
  for (std::size_t row = 0; row < shown["points"].size(); ++row) {
    shown["points"][row]["difference_rad"] = toJson(comparison.difference(static_cast<int>(row)));
  }
  printResult(
      format, report, [&] { return csvTable(comparison, report); }, shown);
  return comparison.reason.empty() ? kDone : kNotPossible;
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
