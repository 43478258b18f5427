#include <algorithm>
#include <cmath>
#include <memory>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/lie/se2.hpp"
#include "helix_arm/model/curve.hpp"
#include "measurements.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;

constexpr int kMostSamples = 1000000;

struct ForwardOptions {
  std::string scene, pressure_kpa, input, inputs, history;
  TierArguments tier;
  int samples = 0;
};

// One row of a history.
struct HistoryRow {
  std::optional<double> time;
  Eigen::VectorXd pressure, effective;  // (n)
  bool known;
  statics::Tip tip;
};

struct ForwardResult {
  statics::TierChoice choice;
  Eigen::VectorXd inputs, lengths;
  statics::Solution solution;
  int full_rank;
  std::vector<json> sections;  // {rank, condition, null_space}
  std::vector<model::CurvePoint<lie::SE3>> curve;
  model::ArmResponse response;   // at the inputs
  Eigen::VectorXd measured;      // (n) last row of the history, or the inputs
  std::vector<HistoryRow> rows;  // of the history
};

template <class Group>
std::vector<json> sectionsOf(const model::ArmOf<Group>& arm) {
  std::vector<json> sections;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto& equilibrium = arm.equilibrium(k);
    json null_space = json::array();
    for (int j = 0; j < equilibrium.null_space.cols(); ++j) {
      null_space.push_back(
          toJson(lie::inSpace(typename Group::Tangent(equilibrium.null_space.col(j)))));
    }
    sections.push_back({{"rank", equilibrium.rank},
                        {"condition", equilibrium.condition},
                        {"null_space", null_space}});
  }
  return sections;
}

ForwardResult forward(const statics::ArmModel& model, const Eigen::VectorXd& inputs, int samples) {
  const bool planar = model.choice().setting.tier == statics::Tier::kPlanar;
  ForwardResult result{model.choice(),
                       inputs,
                       model.arm().lengths(inputs),
                       model.solve(inputs),
                       planar ? lie::SE2::kDof : lie::SE3::kDof,
                       planar ? sectionsOf(*model.planar()) : sectionsOf(model.arm()),
                       {},
                       model::ArmResponse(model.arm()),
                       inputs,
                       {}};
  if (samples > 0) result.curve = model.curve(inputs, samples);
  return result;
}

// The rows in their order; the shape is that at the last one.
ForwardResult forward(const statics::ArmModel& model, const model::InputHistory& history,
                      int samples) {
  model::ArmResponse response(model.arm());
  std::vector<HistoryRow> rows;
  for (Eigen::Index k = 0; k < history.rows(); ++k) {
    response.follow(history, k);
    const Eigen::VectorXd effective = model.arm().clamped(response.effective());
    rows.push_back({history.time.empty() ? std::nullopt
                                         : std::optional(history.time[static_cast<std::size_t>(k)]),
                    history.input.row(k), effective, response.known(), model.tip(effective)});
  }
  ForwardResult result = forward(model, rows.back().effective, samples);
  result.response = std::move(response);
  result.measured = rows.back().pressure;
  result.rows = std::move(rows);
  return result;
}

json helixJson(const lie::Vector6& twist) {
  constexpr double kStraight = 1e-12;  // below it, a curvature is rounding error [rad]
  if (twist.tail<3>().norm() < kStraight) {
    return {{"radius_m", nullptr}, {"pitch_m", 0.0}, {"turns", 0.0}};
  }
  const model::Helix helix = model::helixOf(twist);
  return {{"radius_m", helix.radius}, {"pitch_m", helix.pitch}, {"turns", helix.turns}};
}

// What a row of csv has besides vectors; tables of many rows build no more of the report.
json summaryOf(const ForwardResult& result) {
  const statics::TierSetting& setting = result.choice.setting;
  int rank = result.full_rank;
  double condition = 0;
  for (const json& section : result.sections) {
    rank = std::min(rank, section["rank"].get<int>());
    condition = std::max(condition, section["condition"].get<double>());
  }
  return {{"tier", statics::nameOf(setting.tier)},
          {"order", setting.order > 0 ? json(setting.order) : json()},
          {"tip_error_percent", finite(100 * result.choice.relative_tip_error)},
          {"status", statics::nameOf(result.solution.status)},
          {"relative_residual", result.solution.residual},
          {"iterations", result.solution.iterations},
          {"rank", rank},
          {"condition", condition}};
}

json reportOf(const io::Scene& scene, const ForwardResult& result) {
  const model::Twists twists = result.solution.shape.twists();  // means
  json sections = result.sections;
  for (std::size_t k = 0; k < sections.size(); ++k) {
    const lie::Vector6 twist = twists.col(static_cast<int>(k));
    sections[k].update({{"name", scene.looks[k].name},
                        {"curvature_rad", model::curvatureOf(twist)},
                        {"helix", helixJson(twist)}});
  }
  const bool converged = result.solution.converged();
  json document = summaryOf(result);
  document.update({{"scene", scene.name},
                   {"tier_reason", result.choice.reason},
                   {"failure", converged ? json() : json(reasonForNoShape(result.solution.status))},
                   {"twist", toJson(twists)},
                   {"tip", toJson(result.solution.tip)},
                   {"lengths_m", toJson(result.lengths)},
                   {"full_rank", result.full_rank},
                   {"sections", sections}});
  addInputs(scene.arm, result.measured, document);
  addResponse(scene.arm, result.response, static_cast<Eigen::Index>(result.rows.size()), document);
  if (!result.rows.empty()) {
    document["effective_pressure_pa"] = toJson(result.inputs);
    json& rows = document["history"] = json::array();
    for (const HistoryRow& row : result.rows) {
      rows.push_back({{"time_s", toJson(row.time)},
                      {"pressure_pa", toJson(row.pressure)},
                      {"effective_pressure_pa", toJson(row.effective)},
                      {"memory_known", row.known},
                      {"tip", row.tip.converged() ? toJson(row.tip.tip) : json()}});
    }
  }
  if (result.solution.shape.piecesPerSection() > 1) {
    document["pieces"] = result.solution.shape.piecesPerSection();
    document["piece_twist"] = rowsJson(result.solution.shape.pieces().transpose());
  }
  if (!result.curve.empty()) {
    json& curve = document["curve"] = json::array();
    for (const auto& point : result.curve) {
      json entry = toJson(point.X);
      entry["s"] = point.s;
      curve.push_back(std::move(entry));
    }
  }
  return document;
}

CsvTable::Row rowOf(const io::Scene& scene, const ForwardResult& result) {
  const json summary = summaryOf(result);
  CsvTable::Row row = cellsOf(summary, {"tier", "order", "status"});
  appendInputs(scene.arm, result.inputs, row);
  for (int i = 0; i < result.lengths.size(); ++i) {
    row.emplace_back("length_" + std::to_string(i + 1) + "_m", exact(result.lengths[i]));
  }
  appendTwists(toJson(result.solution.shape.twists()), scene.arm.sectionCount(), row);
  appendPose("tip_", toJson(result.solution.tip), row);
  for (auto& cell : cellsOf(summary, {"rank", "condition", "relative_residual", "iterations",
                                      "tip_error_percent"})) {
    row.push_back(std::move(cell));
  }
  return row;
}

// The rows of the history, or the curve if it was requested; otherwise one row with all numbers.
CsvTable csvTable(const io::Scene& scene, const ForwardResult& result) {
  CsvTable table;
  for (const auto& point : result.curve) {
    CsvTable::Row row{{"s", exact(point.s)}};
    appendPose("", toJson(point.X), row);
    table.add(row);
  }
  for (const HistoryRow& row : result.rows) {
    CsvTable::Row cells{{"time_s", exact(row.time)}};
    appendInputs(scene.arm, row.pressure, cells);
    for (int i = 0; i < row.effective.size(); ++i) {
      cells.emplace_back("effective_pressure_" + std::to_string(i + 1) + "_pa",
                         exact(row.effective[i]));
    }
    cells.emplace_back("memory_known", row.known ? "1" : "0");
    cells.emplace_back("status", statics::nameOf(row.tip.status));
    appendPose("tip_", toJson(row.tip.tip), cells);
    table.add(cells);
  }
  if (result.curve.empty() && result.rows.empty()) table.add(rowOf(scene, result));
  return table;
}

// The report without the history, and with what the numbers leave open.
json shownOf(const io::Scene& scene, const ForwardResult& result, json report) {
  report["tier"] = result.choice.setting.name();
  if (!result.rows.empty()) report["history"] = std::to_string(result.rows.size()) + " rows";
  report.erase("order");
  report.erase("piece_twist");
  const std::string note = noteOnResponse(scene.arm);
  if (result.rows.empty() && !note.empty()) {
    report.erase("response");
    report["notes"] = {note + "; --history follows measured pressures"};
  }
  return report;
}

// One result per row of a table.
int runRows(const ForwardOptions& options, const GlobalOptions& global, const io::Scene& scene) {
  if (!options.pressure_kpa.empty() || !options.input.empty() || !options.history.empty() ||
      options.samples > 0) {
    throw CallerError("--inputs excludes --pressure-kpa, --input, --history and --samples");
  }
  const io::DataSet data = tableOf(options.inputs);
  const Eigen::MatrixXd inputs = inputRowsOf(scene, data);
  const statics::ArmModel model = modelOf(scene, options.tier);
  RowPrinter rows(global.format, scene.name);
  bool all_converged = true;
  for (Eigen::Index row = 0; row < inputs.rows(); ++row) {
    const ForwardResult result = forward(model, inputs.row(row), 0);
    all_converged = all_converged && result.solution.converged();
    rows.add(
        "line " + std::to_string(data.lines[static_cast<std::size_t>(row)]),
        [&] { return reportOf(scene, result); }, [&] { return rowOf(scene, result); },
        {"status", "tip"});
  }
  rows.end();
  return all_converged ? kDone : kNotPossible;
}

int run(const ForwardOptions& options, const GlobalOptions& global) {
  if (!options.history.empty() && (!options.pressure_kpa.empty() || !options.input.empty())) {
    throw CallerError("--history gives the pressures; leave out --pressure-kpa and --input");
  }
  if (!options.history.empty() && options.samples > 0 && global.format == Format::kCsv) {
    throw CallerError("with --history, csv has the rows of the history; leave out --samples");
  }
  if (options.pressure_kpa.empty() && options.input.empty() && options.inputs.empty() &&
      options.history.empty()) {
    throw CallerError("give --pressure-kpa, --input, --inputs or --history");
  }
  const io::Scene scene = loadScene(options.scene, global);
  if (!options.inputs.empty()) return runRows(options, global, scene);
  const statics::ArmModel model = modelOf(scene, options.tier);
  const ForwardResult result =
      options.history.empty()
          ? forward(
                model,
                inputsOf(scene, "--pressure-kpa", options.pressure_kpa, "--input", options.input),
                options.samples)
          : forward(model, historyOfFile(scene, options.history), options.samples);
  const json report = reportOf(scene, result);
  printResult(
      global.format, report, [&] { return csvTable(scene, result); },
      shownOf(scene, result, report));
  return result.solution.converged() ? kDone : kNotPossible;
}

}  // namespace

Subcommand addForward(CLI::App& app) {
  CLI::App* command = app.add_subcommand("forward", "pressures to the shape and tip of the arm");
  const auto options = std::make_shared<ForwardOptions>();
  addScene(*command, "SCENE", options->scene, "scene file")->required();
  addOption(*command, "--pressure-kpa", options->pressure_kpa,
            "gauge pressures [kPa], one per actuator: a,b,c");
  addOption(
      *command, "--input", options->input,
      "inputs in SI units instead of kPa, one per actuator: pressures [Pa], spool angles [rad]");
  addOption(*command, "--inputs", options->inputs,
            "one result per row of this table, or of stdin where it is -: columns pressure_1_kpa "
            ".., pressure_1_pa .. or input_1 .. in SI units");
  addOption(*command, "--history", options->history, kHistoryHelp);
  addTierOptions(*command, options->tier);
  addOption(*command, "--samples", options->samples,
            "also give the curve at N evenly spaced s; s runs over [k, k + 1] along section k",
            CLI::Range(2, kMostSamples));
  command->footer(R"(json: tier, order (of the loaded tier, else null), tier_reason,
tip_error_percent (largest tip error of the tier, of the arm's length; null if it does
not always converge), status (converged, not_converged, snapped, unsupported), failure (null if
converged), relative_residual (last iteration's motion over the arm's size),
iterations, twist (sections x 6; under load their means), tip {position_m,
quaternion_xyzw}, lengths_m (free lengths), rank (least of the sections), full_rank,
condition (largest), sections [{name, rank, condition, null_space (twists that cost no
energy), curvature_rad, helix {radius_m (null if straight), pitch_m, turns}}],
pressure_pa, actuators; under load pieces (per section) and piece_twist (all pieces x 6;
their ends lie on the curve, and between them they are helices, off the curve by 2e-5 of
the length and more); with --samples curve [{s, position_m, quaternion_xyzw}]. csv: one
row, or the rows of the curve. With --inputs json is {scene, rows [as above]}, csv has a row
for each input. With --history the result is that of its last row;
json: effective_pressure_pa, history [{time_s, pressure_pa, effective_pressure_pa, memory_known,
tip}]; csv: one row for each of its rows. Of actuators with a response: response
{history_rows, memory_known, half_width_pa (of the hysteresis loop), uncertainty_pa (of
the effective pressures, until the memory is known), note (without a history: what is left
out), with a slow state rest_time_s}.
--tier, --order, --accuracy and --budget replace everything that the scene says about
the tier.
Exit code 1 if no shape balances the load.)");
  return {command, [options](const GlobalOptions& global) { return run(*options, global); }};
}

}  // namespace helix_arm::cli
