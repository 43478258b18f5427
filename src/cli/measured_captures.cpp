// Measured captures: their shapes (fit), and the model beside them (evaluate).
#include <algorithm>
#include <map>
#include <set>

#include "bag/bag_captures.hpp"
#include "basics/median.hpp"
#include "basics/quote.hpp"
#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/calibration/series_fit.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "helix_arm/model/curve.hpp"
#include "measurements.hpp"
#include "procedures/calibration_job.hpp"
#include "procedures/captures.hpp"
#include "procedures/report_plot.hpp"
#include "procedures/response_series.hpp"
#include "procedures/stand_calibration.hpp"

namespace helix_arm::cli {
namespace {

using estimation::FitStatus;
using estimation::TagLayout;
using procedures::CornersOfTags;
using procedures::PosesOfTags;

// One capture of tags and the shape fitted to it, which is absent where no shape fits them.
struct FittedCapture : procedures::FittedShape {
  estimation::Capture measured;   // the tags that the scene has
  std::vector<int> unknown_tags;  // ids that it has not
  FitStatus status = FitStatus::kConverged;
  std::string reason = {};  // why it did not converge; empty where it did

  bool converged() const { return status == FitStatus::kConverged; }
  // Fitted, all its tags agree, and as well as those of the others.
  bool sound() const { return converged() && fit->outliers() == 0 && !usual_rms; }
  // Ids of the tags that do not fit.
  std::vector<int> outlierTags(const TagLayout& layout) const {
    std::vector<int> ids;
    if (!fit) return ids;
    for (const estimation::TagResidual& tag : fit->tags) {
      if (tag.outlier) ids.push_back(layout.tags[tag.tag].id);
    }
    std::sort(ids.begin(), ids.end());
    return ids;
  }
};

std::string reasonOf(const io::Scene& scene, const FittedCapture& capture) {
  const std::string check =
      "; check that their positions are in metres and seen from the arm's base, and where the "
      "scene places the tags";
  switch (capture.status) {
    case FitStatus::kConverged:
      return {};
    case FitStatus::kNotConverged:
      return "the fit of a shape to its tags did not converge" + check;
    case FitStatus::kUnexplained:
      return "no shape of the arm fits more than half of its tags" + check;
    case FitStatus::kUnderdetermined:
      break;
  }
  std::vector<int> tags;
  const estimation::Reading& reading = capture.measured.reading;
  if (const auto* poses = std::get_if<PosesOfTags>(&reading)) {
    for (const auto& seen : *poses) tags.push_back(seen.tag);
  } else {
    for (const auto& seen : std::get<CornersOfTags>(reading)) tags.push_back(seen.tag);
  }
  // Three points determine a section's twist, two in a plane; one pose counts as all of them.
  const int places = scene.vision.fit.planar ? 2 : 3;
  return whyUndetermined(scene, tags, scene.vision.fit.rotation_noise > 0 ? 1 : places);
}

// The captures of a data set of tag poses or corners. Pressures beside tag poses may be outside the
// limits: they are but where the fit begins.
// @throws CallerError where the scene has no tags, io::DocumentError on faulty data.
std::vector<FittedCapture> capturesOf(const io::Scene& scene, const io::DataSet& data) {
  std::vector<FittedCapture> captures;
  if (data.find("x1_px") >= 0) {
    const procedures::LoadedCaptures read = procedures::loadCaptures(scene, data);
    for (const auto& measured : read.captures) captures.push_back({{}, measured, read.unknown_ids});
    return captures;
  }
  refuseIf(!scene.tags, data.path, " holds tag poses, but scene ", scene.name,
           " has no tags; expected a scene with a section tags");
  std::map<int, statics::PointLoad> payloads = procedures::payloadsOf(scene, data);
  for (const io::TagPoseCapture& measured :
       io::loadTagPoses(data, scene.arm.actuatorCount(), scene.X_BF)) {
    FittedCapture capture{{}, {measured.number, measured.pressure, {}}, {}};
    PosesOfTags seen;
    for (const io::TagPose& tag : measured.tags) {
      const int index = scene.tags->find(tag.id);
      if (index >= 0) seen.push_back({index, tag.X_BT});
      if (index < 0) capture.unknown_tags.push_back(tag.id);
    }
    capture.measured.reading = std::move(seen);
    const auto load = payloads.find(measured.number);
    if (load != payloads.end()) capture.measured.payload = load->second;
    captures.push_back(std::move(capture));
  }
  return captures;
}

// Fits every capture by itself, from the model's shape or, where its load finds no balance, that
// without load, and compares how well they fit.
// @throws CallerError as capturesOf(), and where the scene has tendons.
std::vector<FittedCapture> fitCaptures(const io::Scene& scene, const io::DataSet& data) {
  requirePressureDriven(scene);
  std::vector<FittedCapture> captures = capturesOf(scene, data);
  std::vector<estimation::Capture> measured;
  for (const FittedCapture& one : captures) measured.push_back(one.measured);
  const std::vector<procedures::FittedShape> shapes = procedures::fitShapes(scene, measured);
  for (std::size_t i = 0; i < captures.size(); ++i) {
    FittedCapture& capture = captures[i];
    static_cast<procedures::FittedShape&>(capture) = shapes[i];
    capture.status = capture.fit->status;
    capture.reason = reasonOf(scene, capture);
    if (!capture.converged() && capture.status != FitStatus::kNotConverged) capture.fit.reset();
  }
  return captures;
}

// The tags of a capture; corners are where the shape that fits them has its tags.
PosesOfTags tagsOf(const io::Scene& scene, const FittedCapture& capture) {
  if (const auto* poses = std::get_if<PosesOfTags>(&capture.measured.reading)) return *poses;
  if (!capture.fit) return {};
  const std::vector<lie::SE3> places = estimation::tagPoses(*scene.tags, capture.fit->shape);
  PosesOfTags out;
  for (const auto& tag : std::get<CornersOfTags>(capture.measured.reading)) {
    out.push_back({tag.tag, capture.fit->X_B0B * places[tag.tag]});
  }
  return out;
}

// The report that fit and evaluate give alike of a capture.
json captureJson(const FittedCapture& capture, const TagLayout& layout) {
  return {{"capture", capture.measured.number},
          {"pressure_pa", capture.measured.pressure},
          {"status", estimation::nameOf(capture.status)},
          {"converged", capture.converged()},
          {"reason", textOrNull(capture.reason)},
          {"model_status", statics::nameOf(capture.model.status)},
          {"outlier_tags", capture.outlierTags(layout)},
          {"unknown_tags", capture.unknown_tags}};
}

// Notes on captures that no shape explains, with RMS, what is usual, and what to do; and on those
// whose model the function has a note on.
void addNotes(const std::vector<FittedCapture>& captures,
              std::string (*noteOn)(const statics::Solution&), json& shown) {
  for (const FittedCapture& capture : captures) {
    if (capture.usual_rms) {
      shown["notes"].push_back(procedures::scatterText(capture.fit->rms, *capture.usual_rms));
    }
    const std::string note = noteOn(capture.model);
    if (note.empty()) continue;
    shown["notes"].push_back("capture " + std::to_string(capture.measured.number) + ": " + note);
  }
}

// Why there is no result; empty where some capture is sound.
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

// The middle value; nothing of none.
std::optional<double> median(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  return basics::medianOf(std::move(values));
}

struct CaptureOptions {
  std::string scene, data, png, contraction;
  std::optional<int> muscles;               // on a testing machine
  procedures::RecordedPressures pressures;  // of recordings of bodies
};

json fittedJson(const FittedCapture& capture, const TagLayout& layout) {
  json result = captureJson(capture, layout);
  result["tags"] = json::array();
  result["usual_rms_m"] = capture.usual_rms;
  for (const char* key : {"twist", "covariance", "rms_m", "tip", "base"}) result[key] = nullptr;
  if (capture.fit) {
    const estimation::TwistFit& fit = *capture.fit;
    result["tags"] = listJson(fit.tags, [&layout](const estimation::TagResidual& tag) -> json {
      return {{"id", layout.tags[tag.tag].id},
              {"residual_m", tag.rms},
              {"weight", tag.weight},
              {"outlier", tag.outlier}};
    });
    result["twist"] = fit.twists.transpose();
    result["covariance"] = fit.covariance;
    result["rms_m"] = fit.rms;
    result["tip"] = measuredTip(fit);
    result["base"] = fit.X_B0B;
  }
  return result;
}

json reportOf(const io::Scene& scene, const std::vector<FittedCapture>& captures,
              const std::vector<estimation::Suspect>& suspects) {
  json list = json::array(), flagged = json::array();  // flagged: with tags that do not fit
  std::vector<double> rms;                             // of the valid captures [m]
  std::set<int> unknown;
  for (const FittedCapture& capture : captures) {
    list.push_back(fittedJson(capture, *scene.tags));
    if (capture.sound()) rms.push_back(capture.fit->rms);
    const bool unexplained = capture.status == FitStatus::kUnexplained;
    if (unexplained || capture.usual_rms || (capture.fit && capture.fit->outliers() > 0)) {
      flagged.push_back(capture.measured.number);
    }
    unknown.insert(capture.unknown_tags.begin(), capture.unknown_tags.end());
  }
  return {{"scene", scene.name},
          {"captures", list},
          {"median_rms_m", median(std::move(rms))},
          {"flagged_captures", flagged},
          {"unknown_tags", unknown},
          {"suspects", suspects},
          {"reason", textOrNull(reasonForNoFit(captures))}};
}

// With a column for the residual of each tag of the scene.
void printTable(const io::Scene& scene, json report, std::ostream& out) {
  Columns columns = {"capture",      "status",      "converged",    "pressure_pa", "rms_m",
                     "outlier_tags", "usual_rms_m", "unknown_tags", "twist",       "covariance"};
  for (const auto& placed : scene.tags->tags) {
    const std::string column = "tag_" + std::to_string(placed.id) + "_residual_m";
    columns.push_back(column);
    for (json& capture : report["captures"]) {
      capture[column] = nullptr;
      for (const json& tag : capture["tags"]) {
        if (tag["id"] == placed.id) capture[column] = tag["residual_m"];
      }
    }
  }
  columns.push_back("model_status");
  printCsv(report, {columns, "captures", {"median_rms_m", "reason"}, &scene.arm}, out);
}

// The report without the residuals of single tags, and with what it means.
json shownOf(const io::Scene& scene, const std::vector<FittedCapture>& captures,
             const json& report) {
  json shown =
      without(report, {"tags", "base", "model_status", "usual_rms_m", "converged", "suspects"});
  if (!report["median_rms_m"].is_null()) {
    const double noise = 1e3 * scene.vision.fit.position_noise;
    shown["notes"].push_back(basics::format(
        "an RMS of about %.1f mm is expected: vision.tag_position_noise_m is %g mm per axis",
        std::sqrt(scene.vision.fit.planar ? 2.0 : 3.0) * noise, noise));
  }
  addNotes(captures, noteOnStart, shown);
  return shown;
}

int runFit(const CaptureOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  const io::DataSet data = io::loadDataSet(options.data);
  const std::vector<FittedCapture> captures = fitCaptures(scene, data);
  std::vector<estimation::Capture> seen;
  for (const FittedCapture& one : captures) seen.push_back(one.measured);
  const std::vector<estimation::Suspect> suspects = procedures::tagSuspectsOf(scene, seen);
  json report = reportOf(scene, captures, suspects);
  report["missing_columns"] = missingColumns(scene, data);
  json shown = shownOf(scene, captures, report);
  for (const std::string& text : procedures::textsOf(suspects)) shown["notes"].push_back(text);
  printResult(global.format, report, shown,
              [&](std::ostream& out) { printTable(scene, report, out); });
  return report["reason"].is_null() ? kDone : kNotPossible;
}

// RMS distance of the model's tags from those measured that fit one shape; nothing of none [m].
std::optional<double> tagDistance(const io::Scene& scene, const FittedCapture& capture) {
  const std::vector<lie::SE3> model = estimation::tagPoses(*scene.tags, capture.model.shape);
  const std::vector<int> outliers = capture.outlierTags(*scene.tags);
  double square = 0;
  int count = 0;
  for (const estimation::PoseObservation& seen : tagsOf(scene, capture)) {
    const int id = scene.tags->tags[seen.tag].id;
    if (std::find(outliers.begin(), outliers.end(), id) != outliers.end()) continue;
    square += (model[seen.tag].translation - seen.X_BT.translation).squaredNorm();
    ++count;
  }
  return count > 0 ? std::optional(std::sqrt(square / count)) : std::nullopt;
}

// @param fit_rms  the key of a fit's RMS, whose unit it names.
json comparisonOf(const io::Scene& scene, const std::vector<FittedCapture>& fitted,
                  const char* fit_rms) {
  const double arm_length = scene.arm.restLength();
  const auto percent = [arm_length](const std::optional<double>& error) {
    return error ? json(100 * *error / arm_length) : json();
  };
  // Too few tags for a shape, such as one at the tip, have places nevertheless.
  const bool only_places = std::all_of(
      fitted.begin(), fitted.end(),
      [](const FittedCapture& capture) { return capture.status == FitStatus::kUnderdetermined; });
  json captures = json::array();
  std::vector<double> rms, tip_errors;  // of the valid captures [m]
  for (const FittedCapture& capture : fitted) {
    std::optional<double> tags, tip;
    if (only_places && capture.model.converged()) {
      tags = tagDistance(scene, capture);
      if (tags) rms.push_back(*tags);
    }
    if (capture.model.converged() && capture.converged()) {
      tags = tagDistance(scene, capture);
      tip = (capture.model.tip.translation - measuredTip(*capture.fit).translation).norm();
      if (capture.sound()) rms.push_back(*tags);
      if (capture.sound()) tip_errors.push_back(*tip);
    }
    captures.push_back(captureJson(capture, *scene.tags));
    captures.back().update({{"rms_m", tags},
                            {"tip_error_m", tip},
                            {"tip_error_percent", percent(tip)},
                            {fit_rms, capture.fit ? json(capture.fit->rms) : json()},
                            {"usual_fit_rms_m", capture.usual_rms}});
  }
  const std::optional<double> tip_error = median(tip_errors);
  std::string reason = rms.empty() ? reasonForNoFit(fitted) : "";
  if (reason.empty() && rms.empty()) {
    const auto lacking = std::find_if(fitted.begin(), fitted.end(), [](const auto& capture) {
      return !capture.model.converged();
    });
    reason = "the model finds no shape for any valid capture: " +
             reasonForNoShape(lacking->model.status);
  }
  return {{"scene", scene.name},
          {"tier", statics::nameOf(scene.model.choice().setting.tier)},
          {"captures", captures},
          {"median_rms_m", median(rms)},
          {"median_tip_error_percent", percent(tip_error)},
          {"arm_length_m", arm_length},
          {"reason", textOrNull(reason)}};
}

// Compares the model's tags and tip with measured tag poses or corners, and prints it. @return the
// exit code. @throws as fitCaptures(), and io::DocumentError with every
// pressure outside the limits.
int evaluateTags(const io::Scene& scene, const io::DataSet& data, Format format) {
  procedures::pressuresWithinLimits(data, scene.arm);
  const std::vector<FittedCapture> captures = fitCaptures(scene, data);
  json report = comparisonOf(scene, captures, data.find("x1_px") >= 0 ? "fit_rms_px" : "fit_rms_m");
  report["missing_columns"] = missingColumns(scene, data);
  json shown = without(report, {"converged", "usual_fit_rms_m"});
  const auto noteOn = [](const statics::Solution& model) {
    return model.converged() ? "" : reasonForNoShape(model.status);
  };
  addNotes(captures, noteOn, shown);
  printResult(format, report, shown,
              Csv{{"capture", "status", "pressure_pa", "rms_m", "tip_error_m", "tip_error_percent",
                   "outlier_tags", "unknown_tags", "model_status"},
                  "captures",
                  {"median_rms_m", "median_tip_error_percent", "reason"}});
  return report["reason"].is_null() ? kDone : kNotPossible;
}

void requireComparable(const io::Scene& scene, const io::DataSet& data) {
  refuseIf(data.find("curvature_rad") < 0, data.path,
           " has no measurements to compare with; expected the columns pressure_1_kpa "
           ".. and curvature_rad, tag poses or tag corners");
  requirePressureDriven(scene);
  refuseIf(scene.arm.sectionCount() != 1, "curvature_rad applies to arms of one section; scene ",
           scene.name, " has ", scene.arm.sectionCount());
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
    double model = std::nan("");
    if (solution.converged()) {
      model = model::curvatureOf(solution.shape.twists().col(0));
      square += std::pow(model - measured[row], 2);
      most = std::max(most, std::abs(model - measured[row]));
      ++count;
    } else if (reason.is_null()) {
      reason = "row " + std::to_string(row + 1) + ": " + reasonForNoShape(solution.status);
    }
    points.push_back({{"pressure_pa", pressures.row(row)},
                      {"measured_rad", measured[row]},
                      {"model_rad", model},
                      {"difference_rad", model - measured[row]}});
  }
  const json report{{"scene", scene.name},
                    {"tier", statics::nameOf(scene.model.choice().setting.tier)},
                    {"rms_rad", std::sqrt(square / count)},
                    {"max_rad", valueIf(count > 0, most)},
                    {"reason", reason},
                    {"missing_columns", missingColumns(scene, data)},
                    {"points", without(points, {"difference_rad"})}};
  json shown = report;
  shown["points"] = points;
  const Csv csv{{"pressure_pa", "measured_rad", "model_rad", "difference_rad"},
                "points",
                {"rms_rad", "max_rad", "reason"}};
  printResult(format, report, shown, [&](std::ostream& out) { printCsv(shown, csv, out); });
  return reason.is_null() ? kDone : kNotPossible;
}

json residualJson(const estimation::SeriesResidual& one) {
  json out{{"rows", one.rows},
           {"rms_m", one.rms},
           {"rms_without_offset_m", one.rms_about_offset},
           {"worst_m", one.worst},
           {"rms_at_rest_m", one.rms_at_rest},
           {"rms_in_motion_m", one.rms_in_motion},
           {"offset_m", one.offset}};
  if (!std::isnan(one.rms_turn)) out["rms_rad"] = one.rms_turn;
  return out;
}

// For plot_report: the coordinates of measured and modelled tips over the time.
json plotOf(const io::Scene& scene, const procedures::ResponseSeries& tips,
            const estimation::SeriesComparison& found) {
  json time = json::array(), measured = json::array(), model = json::array(), trial = json::array();
  Eigen::Index row = 0;
  int current = -1;
  for (std::size_t k = 0; k < found.rows.size(); ++k) {
    for (; row <= found.rows[k]; ++row) {
      current += tips.history.starts_anew[static_cast<std::size_t>(row)] ? 1 : 0;
    }
    const Eigen::VectorXd seen =
        tips.reading.row(found.rows[k]).head(found.deviation.cols()).transpose();
    const Eigen::VectorXd off = found.deviation.row(static_cast<Eigen::Index>(k)).transpose();
    time.push_back(tips.history.time[static_cast<std::size_t>(found.rows[k])]);
    trial.push_back(basics::printable(tips.trials[static_cast<std::size_t>(current)]));
    measured.push_back(seen);
    model.push_back(Eigen::VectorXd(seen + off));
  }
  return {{"scene", scene.name},
          {"series",
           {{"time_s", time}, {"trial", trial}, {"measured_m", measured}, {"model_m", model}}}};
}

// Compares the model's tip with a series of measured ones, without times of an arm that rests at
// each, and prints it. @return the exit code.
int evaluateSeries(const io::Scene& scene, const io::DataSet& data, const CaptureOptions& options,
                   Format format) {
  requirePressureDriven(scene);
  const procedures::ResponseSeries tips = procedures::tipSeriesOf(data, scene.arm.actuatorCount());
  refuseIf(tips.history.time.empty() && !options.png.empty(), "--png draws over the time, but ",
           data.path, " has no column time_s");
  const estimation::SeriesComparison found =
      estimation::compareSeries(procedures::priorOf(scene), procedures::ofArm(tips));
  json trials = json::array();
  for (std::size_t k = 0; k < found.trials.size(); ++k) {
    json one{{"trial", basics::printable(tips.trials[k])}};
    one.update(residualJson(found.trials[k]));
    trials.push_back(std::move(one));
  }
  const bool solved = found.deviation.allFinite();
  json report{{"scene", scene.name},
              {"tier", statics::nameOf(scene.model.choice().setting.tier)},
              {"reason", valueIf(!solved,
                                 "the model finds no shape under its load at some pressures; check "
                                 "load and stiffness of the scene")}};
  report.update(residualJson(found.all));
  report["baseline_rms_m"] = found.baseline_rms;
  report["trials"] = trials;
  report["missing_columns"] = missingColumns(scene, data);
  report["png"] = solved ? textOrNull(options.png) : json();
  if (!options.png.empty() && solved) {
    procedures::drawReport(plotOf(scene, tips, found).dump(), options.png, "leave out --png");
  }
  Columns columns{"trial",   "rows",          "rms_m",           "rms_without_offset_m",
                  "worst_m", "rms_at_rest_m", "rms_in_motion_m", "offset_m"};
  if (report.contains("rms_rad")) columns.push_back("rms_rad");
  json shown = report;
  if (found.all.rms > estimation::kMostOfBaseline * found.baseline_rms) {
    shown["note"] = estimation::kBeyondBaseline;
  }
  printResult(format, report, shown,
              Csv{columns,
                  "trials",
                  {"rms_m", "baseline_rms_m", "rms_without_offset_m", "worst_m", "reason"}});
  return solved ? kDone : kNotPossible;
}

int evaluateStand(const io::Scene& scene, const CaptureOptions& options, Format format) {
  const estimation::StandRun run = procedures::loadStand({options.data}).runs.front();
  const estimation::StandComparison found = estimation::compareStand(
      procedures::standLawOf(scene, options.contraction), run, *options.muscles);
  const json report{{"scene", scene.name},
                    {"muscles", *options.muscles},
                    {"rows", run.readings.size()},
                    {"rms_n", found.rms},
                    {"worst_n", found.residual.lpNorm<Eigen::Infinity>()},
                    {"span_n", found.span},
                    {"loop_n", found.loop},
                    {"rows_beyond_curve", found.beyond}};
  json shown = report;
  if (found.beyond > 0) shown["note"] = "pressures beyond the scene's curve count as its end";
  printResult(
      format, report, shown,
      Csv{{"rms_n", "worst_n", "span_n", "loop_n", "rows", "muscles", "rows_beyond_curve"}});
  return kDone;
}

int runEvaluate(const CaptureOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  refuseIf(!options.contraction.empty() && !options.muscles, "--contraction needs --muscles");
  if (options.muscles) return evaluateStand(scene, options, global.format);
  std::vector<std::string> notes;
  const io::DataSet data = ros_bridge::loadDataSet(scene, options.data, options.pressures, notes);
  for (const std::string& note : notes) std::cerr << note << "\n";
  if (data.find("x_m") >= 0 && data.find("tag") < 0) {
    return evaluateSeries(scene, data, options, global.format);
  }
  refuseIf(data.find("force_n") >= 0, data.path,
           " holds forces of a testing machine; give --muscles, the number of muscles in parallel");
  refuseIf(!options.png.empty(), "--png draws a series of the tip; ", data.path, " holds none");
  const bool tags = data.find("curvature_rad") < 0 && data.find("tag") >= 0;
  return tags ? evaluateTags(scene, data, global.format)
              : evaluateCurvature(scene, data, global.format);
}

}  // namespace

void addFit(Commands& commands) {
  auto [command, options] =
      commands.add<CaptureOptions>("fit", "measured tag poses to one twist per capture", runFit);
  addScene(command, options.scene, "scene file with tags");
  addOption(command, "TAG_POSES", options.data,
            "data set (# comments, a header, one row per tag) with the columns capture, "
            "pressure_1_kpa .. (gauge), tag, x_m, y_m, z_m, qx, qy, qz, qw, seen from the scene's "
            "tags.frame (default: the arm's base)",
            kRequired);
  command.footer(
      R"(json: captures [{capture, pressure_pa, status, converged, reason, model_status (unless
converged, the search began at the shape without load), twist, covariance, rms_m (of the
tags that fit), tip and base (fitted, relative to the base's nominal pose),
outlier_tags, usual_rms_m (only where rms_m is far larger than that of the others),
unknown_tags, tags [{id, residual_m, weight, outlier}]}], median_rms_m
over the captures whose tags all fit, flagged_captures (the others), unknown_tags,
suspects [{cause, where, explains, remedy}] (usual mistakes of tags, best first),
reason (if no capture's tags all fit: exit code 1). If the tags determine no shape, or
no shape fits most of them, twist is null. csv: one row per capture.
The 95 % ellipsoid of covariance, of all twists [m, rad], holds the truth in 95 % of
captures, even if few tags determine the noise (chi-square with as many degrees of
freedom as entries).
Expected noise, robustness and whether the base is fitted: keys vision.* of the scene.)");
}

void addEvaluate(Commands& commands) {
  auto [command, options] =
      commands.add<CaptureOptions>("evaluate", "compare the model with measurements", runEvaluate);
  addScene(command, options.scene);
  addOption(
      command, "DATA", options.data,
      "data set (# comments, a header, rows) with the columns pressure_1_kpa .. (gauge; a missing "
      "one is 0) and curvature_rad (length-scaled curvature), the tag poses that fit takes, the "
      "tag corners that simulate writes, a series of the tip (time_s, pressure_1_kpa .., x_m, y_m, "
      "z_m, optionally qx .. qw, trial; without time_s the arm rests at each row), a recording of "
      "bodies (time_s, NAME_x_m .. NAME_qw, or an export of Motive or Vicon) or a rosbag as for "
      "calibrate; columns of a load as for calibrate",
      kRequired);
  addPressures(command, options.pressures);
  addOption(command, "--png", options.png,
            "picture of a series: model and measurement over the time");
  addOption(command, "--muscles", options.muscles,
            "the data are of a testing machine with so many equal muscles in parallel: "
            "pressure_kpa, length_m, force_n",
            CLI::Range(1, 1000));
  addOption(command, "--contraction", options.contraction,
            "with --muscles: name of the muscle's curve, needed if the arm has several");
  command.footer(R"(Curvature, json: rms_rad and max_rad of model - measured, points [{pressure_pa,
measured_rad, model_rad}], tier, reason (if the model finds no shape under its load:
model_rad is null there, exit code 1).
Tag poses or corners, json: captures [{capture, pressure_pa, status (of the fit), converged,
reason, model_status (as that of forward), rms_m (the model's tags against those
measured that fit one shape; all, if no capture's determine one), tip_error_m and
tip_error_percent (model against fitted tip, of the arm's length at rest), outlier_tags,
fit_rms_m (of corners fit_rms_px), usual_fit_rms_m (only where fit_rms_m is far larger than that of the others),
unknown_tags}], median_rms_m and
median_tip_error_percent over the captures whose tags all fit, arm_length_m, tier,
reason.
Series, json: rms_m and worst_m of the tip's distance, baseline_rms_m (of a cubic of the
pressures behind one lag, fitted to this series without the rows that it predicts: each
trial in turn, of fewer than five trials each tenth), rms_without_offset_m (with the mean
deviation of each trial taken off), rms_at_rest_m and rms_in_motion_m, offset_m, rows,
rms_rad of the orientation if the series has one (qx, qy, qz, qw), trials [{trial and the
same}], tier, reason, png. The arm rests at the start of each trial.
With --muscles, json: rms_n and worst_n of model - measured, span_n (of the measured
forces), loop_n (width of the hysteresis loop, in force), rows, rows_beyond_curve (at
pressures beyond the scene's curve), muscles.
csv: the summary as # comments, then one row per point, capture or trial.)");
}

}  // namespace helix_arm::cli
