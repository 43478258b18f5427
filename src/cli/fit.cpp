#include <memory>
#include <set>

#include "arguments.hpp"
#include "command.hpp"
#include "measurements.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using estimation::TagLayout;
using nlohmann::json;

struct FitOptions {
  std::string scene, data;
};

json fittedJson(const FittedCapture& capture, const TagLayout& layout) {
  json tags = json::array();
  json result = captureJson(capture, layout);
  result["usual_rms_m"] = toJson(capture.usual_rms);
  for (const char* key : {"twist", "covariance", "rms_m", "tip", "base"}) result[key] = nullptr;
  if (capture.fit) {
    const estimation::TwistFit& fit = *capture.fit;
    for (const estimation::TagResidual& tag : fit.tags) {
      tags.push_back({{"id", layout.tags[tag.tag].id},
                      {"residual_m", tag.rms},
                      {"weight", tag.weight},
                      {"outlier", tag.outlier}});
    }
    result["twist"] = toJson(fit.twists);
    result["covariance"] = rowsJson(fit.covariance);
    result["rms_m"] = fit.rms;
    result["tip"] = toJson(measuredTip(fit));
    result["base"] = toJson(fit.X_B0B);
  }
  result["tags"] = tags;
  return result;
}

json reportOf(const io::Scene& scene, const std::vector<FittedCapture>& captures) {
  json list = json::array(), flagged = json::array();  // flagged: with tags that do not fit
  std::vector<double> rms;                             // of the valid captures [m]
  std::set<int> unknown;
  for (const FittedCapture& capture : captures) {
    list.push_back(fittedJson(capture, *scene.tags));
    if (capture.sound()) rms.push_back(capture.fit->rms);
    const bool unexplained = capture.status == estimation::FitStatus::kUnexplained;
    if (unexplained || capture.usual_rms || (capture.fit && capture.fit->outliers() > 0)) {
      flagged.push_back(capture.number);
    }
    unknown.insert(capture.unknown_tags.begin(), capture.unknown_tags.end());
  }
  return {{"scene", scene.name},
          {"captures", list},
          {"median_rms_m", toJson(median(std::move(rms)))},
          {"flagged_captures", flagged},
          {"unknown_tags", unknown},
          {"reason", textOrNull(reasonForNoFit(captures))}};
}

// Twists, covariance and residuals; empty cells where there is no fit.
void appendFit(const json& capture, const TagLayout& layout, int sections, CsvTable::Row& row) {
  appendTwists(capture["twist"], sections, row);
  const auto size = static_cast<std::size_t>(6 * sections);
  const json& covariance = capture["covariance"];
  for (std::size_t i = 0; i < size; ++i) {
    for (std::size_t j = i; j < size; ++j) {
      row.emplace_back("covariance_" + std::to_string(i + 1) + "_" + std::to_string(j + 1),
                       covariance.is_null() ? "" : exact(covariance[i][j].get<double>()));
    }
  }
  for (const auto& placed : layout.tags) {
    row.emplace_back("tag_" + std::to_string(placed.id) + "_residual_m", "");
    for (const json& tag : capture["tags"]) {
      if (tag["id"] == placed.id) row.back().second = exact(tag["residual_m"].get<double>());
    }
  }
}

// The table, after comments that are printed at once.
CsvTable csvTable(const io::Scene& scene, const json& report) {
  if (!report["median_rms_m"].is_null()) printComments(report, {"median_rms_m"});
  printReason(report);
  CsvTable table;
  for (const json& capture : report["captures"]) {
    CsvTable::Row row = cellsOf(capture, {"capture", "status", "converged", "pressure_pa", "rms_m",
                                          "outlier_tags", "usual_rms_m", "unknown_tags"});
    appendFit(capture, *scene.tags, scene.arm.sectionCount(), row);
    row.push_back(cellsOf(capture, {"model_status"}).front());
    table.add(row);
  }
  return table;
}

// The report without the residuals of single tags, and with what it means.
json shownOf(const std::vector<FittedCapture>& captures, const json& report) {
  json shown = without(report, {"tags", "base", "model_status", "usual_rms_m", "converged"});
  for (const FittedCapture& capture : captures) {
    if (capture.usual_rms) shown["notes"].push_back(noteOnScatter(capture));
    const std::string note = noteOnStart(capture.model);
    if (note.empty()) continue;
    shown["notes"].push_back("capture " + std::to_string(capture.number) + ": " + note);
  }
  return shown;
}

int run(const FitOptions& options, const GlobalOptions& global) {
  const io::Scene scene = loadScene(options.scene, global);
  const std::vector<FittedCapture> captures = fitCaptures(scene, io::loadDataSet(options.data));
  const json report = reportOf(scene, captures);
  printResult(
      global.format, report, [&] { return csvTable(scene, report); }, shownOf(captures, report));
  return report["reason"].is_null() ? kDone : kNotPossible;
}

}  // namespace

Subcommand addFit(CLI::App& app) {
  CLI::App* command = app.add_subcommand("fit", "measured tag poses to one twist per capture");
  const auto options = std::make_shared<FitOptions>();
  addScene(*command, "SCENE", options->scene, "scene file with tags")->required();
  addOption(*command, "TAG_POSES", options->data,
            "data set (# comments, a header, one row per tag) with the columns capture, "
            "pressure_1_kpa .. (gauge), tag, x_m, y_m, z_m, qx, qy, qz, qw, seen from the scene's "
            "tags.frame (default: the arm's base)",
            kRequired);
  command->footer(
      R"(json: captures [{capture, pressure_pa, status, converged, reason, model_status (unless
converged, the search began at the shape without load), twist, covariance, rms_m (of the
tags that fit), tip and base (fitted, relative to the base's nominal pose),
outlier_tags, usual_rms_m (only where rms_m is far larger than that of the others),
unknown_tags, tags [{id, residual_m, weight, outlier}]}], median_rms_m
over the captures whose tags all fit, flagged_captures (the others), unknown_tags,
reason (if no capture's tags all fit: exit code 1). If the tags determine no shape, or
no shape fits most of them, twist is null. csv: one row per capture.
The 95 % ellipsoid of covariance, of all twists [m, rad], holds the truth in 95 % of
captures, even if few tags determine the noise (chi-square with as many degrees of
freedom as entries).
Expected noise, robustness and whether the base is fitted: keys vision.* of the scene.)");
  return {command, [options](const GlobalOptions& global) { return run(*options, global); }};
}

}  // namespace helix_arm::cli
