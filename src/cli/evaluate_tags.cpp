#include "evaluate_tags.hpp"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <iostream>

#include "helix_arm/estimation/tag_layout.hpp"
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

void printJsonResult(const io::Scene& scene, const TagComparison& c, const std::string& reason) {
  json captures = json::array();
  for (const CaptureComparison& capture : c.captures) {
    captures.push_back(
        {{"capture", capture.measured.number},
         {"pressure_pa", toJson(capture.measured.pressure)},
         {"status", estimation::nameOf(capture.measured.status)},
         {"converged", capture.measured.converged()},
         {"reason", capture.measured.reason.empty() ? json() : json(capture.measured.reason)},
         {"model_status", statics::nameOf(capture.measured.model.status)},
         {"rms_m", toJson(capture.rms)},
         {"tip_error_m", toJson(capture.tip_error)},
         {"tip_error_percent", toJson(c.percent(capture.tip_error))},
         {"outlier_tags", capture.outlier_tags},
         {"fit_rms_m", capture.measured.fit ? json(capture.measured.fit->rms) : json()},
         {"usual_fit_rms_m", toJson(capture.measured.usual_rms)},
         {"unknown_tags", capture.measured.unknown_tags}});
  }
  printJson({{"scene", scene.name},
             {"tier", modelTier(scene)},
             {"captures", captures},
             {"median_rms_m", toJson(c.median_rms)},
             {"median_tip_error_percent", toJson(c.percent(c.median_tip_error))},
             {"arm_length_m", c.arm_length},
             {"reason", reason.empty() ? json() : json(reason)}});
}

void printCsvResult(const io::Scene& scene, const TagComparison& c, const std::string& reason) {
  CsvTable table;
  for (const CaptureComparison& capture : c.captures) {
    CsvTable::Row row{{"capture", std::to_string(capture.measured.number)},
                      {"status", estimation::nameOf(capture.measured.status)}};
    appendInputs(scene.arm, capture.measured.pressure, row);
    row.emplace_back("rms_m", exact(capture.rms));
    row.emplace_back("tip_error_m", exact(capture.tip_error));
    row.emplace_back("tip_error_percent", exact(c.percent(capture.tip_error)));
    row.emplace_back("outlier_tags", joined(capture.outlier_tags));
    row.emplace_back("unknown_tags", joined(capture.measured.unknown_tags));
    row.emplace_back("model_status", statics::nameOf(capture.measured.model.status));
    table.add(row);
  }
  std::cout << "# median_rms_m " << exact(c.median_rms) << "\n# median_tip_error_percent "
            << exact(c.percent(c.median_tip_error)) << "\n";
  if (!reason.empty()) std::cout << "# reason " << reason << "\n";
  table.print(std::cout);
}

void printTextResult(const io::Scene& scene, const TagComparison& c, const std::string& reason) {
  const auto print = [](const std::optional<double>& number, double factor, const char* unit) {
    if (number) {
      std::cout << factor * *number << unit;
    } else {
      std::cout << "-";
    }
  };
  std::cout << scene.name << ", model against measured tags\n"
            << std::fixed << std::setprecision(1);
  for (const CaptureComparison& capture : c.captures) {
    std::cout << "capture " << capture.measured.number << ": tags RMS ";
    print(capture.rms, 1e3, " mm");
    std::cout << ", tip off by ";
    print(capture.tip_error, 1e3, " mm");
    std::cout << " = ";
    print(c.percent(capture.tip_error), 1, " % of the arm");
    if (!capture.outlier_tags.empty()) {
      std::cout << "; wrong: tag " << joined(capture.outlier_tags);
    }
    if (capture.measured.usual_rms) std::cout << "; " << noteOnScatter(capture.measured);
    if (!capture.measured.unknown_tags.empty()) {
      std::cout << "; not in the scene: tag " << joined(capture.measured.unknown_tags);
    }
    if (!capture.measured.model.converged()) {
      std::cout << "; " << reasonForNoShape(capture.measured.model.status);
    }
    if (!capture.measured.converged()) {
      std::cout << "; " << estimation::nameOf(capture.measured.status) << ": "
                << capture.measured.reason;
    }
    std::cout << "\n";
  }
  std::cout << "median over the captures whose tags all fit one shape: RMS ";
  print(c.median_rms, 1e3, " mm");
  std::cout << ", tip ";
  print(c.percent(c.median_tip_error), 1, " %");
  std::cout << "\n" << reason << (reason.empty() ? "" : "\n");
}

}  // namespace

int evaluateTags(const io::Scene& scene, const io::DataSet& data, Format format) {
  procedures::pressuresWithinLimits(data, scene.arm);
  const TagComparison comparison = compareTags(scene, data);
  std::string reason = reasonForNoFit(fittedOf(comparison));
  if (reason.empty()) reason = reasonForNoModel(comparison);
  if (format == Format::kJson) printJsonResult(scene, comparison, reason);
  if (format == Format::kCsv) printCsvResult(scene, comparison, reason);
  if (format == Format::kText) printTextResult(scene, comparison, reason);
  return reason.empty() ? kDone : kNotPossible;
}

}  // namespace helix_arm::cli
