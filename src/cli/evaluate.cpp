#include <cmath>
#include <iomanip>
#include <iostream>
#include <memory>

#include "arguments.hpp"
#include "command.hpp"
#include "evaluate_tags.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/captures.hpp"
#include "measurements.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;

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
                      " has no measurements to compare with; expected the columns "
                      "pressure_1_kpa .. and curvature_rad, or tag poses");
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

void printJsonResult(const io::Scene& scene, const CurvatureComparison& c) {
  json points = json::array();
  for (int row = 0; row < c.measured.size(); ++row) {
    points.push_back({{"pressure_pa", toJson(Eigen::VectorXd(c.pressures.row(row)))},
                      {"measured_rad", c.measured[row]},
                      {"model_rad", toJson(c.model[row])}});
  }
  printJson({{"scene", scene.name},
             {"tier", modelTier(scene)},
             {"rms_rad", toJson(c.rms())},
             {"max_rad", toJson(c.max())},
             {"reason", c.reason.empty() ? json() : json(c.reason)},
             {"points", points}});
}

void printCsvResult(const io::Scene& scene, const CurvatureComparison& c) {
  CsvTable table;
  for (int row = 0; row < c.measured.size(); ++row) {
    CsvTable::Row cells;
    appendInputs(scene.arm, c.pressures.row(row), cells);
    cells.emplace_back("measured_rad", exact(c.measured[row]));
    cells.emplace_back("model_rad", exact(c.model[row]));
    cells.emplace_back("difference_rad", exact(c.difference(row)));
    table.add(cells);
  }
  std::cout << "# rms_rad " << exact(c.rms()) << "\n# max_rad " << exact(c.max()) << "\n";
  if (!c.reason.empty()) std::cout << "# reason " << c.reason << "\n";
  table.print(std::cout);
}

void printTextResult(const io::Scene& scene, const CurvatureComparison& c) {
  constexpr int kWidth = 12;
  std::cout << scene.name << ", length-scaled curvature [rad]\n";
  for (int i = 0; i < scene.arm.actuatorCount(); ++i) {
    std::cout << std::setw(kWidth) << "p" + std::to_string(i + 1) + " [kPa]";
  }
  for (const char* title : {"measured", "model", "difference"})
    std::cout << std::setw(kWidth) << title;
  std::cout << "\n" << std::fixed << std::setprecision(5);
  for (int row = 0; row < c.measured.size(); ++row) {
    for (int i = 0; i < c.pressures.cols(); ++i)
      std::cout << std::setw(kWidth) << c.pressures(row, i) / 1e3;
    std::cout << std::setw(kWidth) << c.measured[row];
    for (const std::optional<double>& number : {c.model[row], c.difference(row)}) {
      std::cout << std::setw(kWidth);
      if (number) {
        std::cout << *number;
      } else {
        std::cout << "-";
      }
    }
    std::cout << "\n";
  }
  if (c.rms()) std::cout << "RMS " << *c.rms() << " rad, max " << *c.max() << " rad\n";
  if (!c.reason.empty()) std::cout << c.reason << "\n";
}

int evaluateCurvature(const io::Scene& scene, const io::DataSet& data, Format format) {
  requireComparable(scene, data);
  const CurvatureComparison comparison = compareCurvature(scene, data);
  if (format == Format::kJson) printJsonResult(scene, comparison);
  if (format == Format::kCsv) printCsvResult(scene, comparison);
  if (format == Format::kText) printTextResult(scene, comparison);
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
  command
      ->add_option(
          "DATA", options->data,
          "data set (# comments, a header, rows) with the columns pressure_1_kpa .. (gauge; a "
          "missing "
          "one is 0) and curvature_rad (length-scaled curvature), or the tag poses that fit takes")
      ->required();
  command->footer(
      "Curvature, json: rms_rad and max_rad of model - measured, points [{pressure_pa,\n"
      "measured_rad, model_rad}], tier, reason (if the model finds no shape under its load:\n"
      "model_rad is null there, exit code 1).\n"
      "Tag poses, json: captures [{capture, pressure_pa, status (of the fit), converged,\n"
      "reason, model_status (as that of forward), rms_m (the model's tags against those\n"
      "measured that fit one shape), tip_error_m and tip_error_percent (model against fitted\n"
      "tip, of the arm's length at rest), outlier_tags, fit_rms_m, usual_fit_rms_m (only where\n"
      "fit_rms_m is far larger than that of the others), unknown_tags}], median_rms_m and\n"
      "median_tip_error_percent over the captures whose tags all fit, arm_length_m, tier,\n"
      "reason.\n"
      "csv: the summary as # comments, then one row per point or capture.");
  return {command, [options](const GlobalOptions& global) { return run(*options, global); }};
}

}  // namespace helix_arm::cli
