// Pressures to the shape of the arm (forward), and a wanted tip, pose or shape to pressures
// (inverse).
#include <Eigen/Geometry>
#include <algorithm>

#include "command.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/clearance/sweep.hpp"
#include "helix_arm/lie/se2.hpp"
#include "helix_arm/model/curve.hpp"
#include "measurements.hpp"

namespace helix_arm::cli {
namespace {

using statics::InverseResult;
using statics::InverseStatus;
using statics::Limit;
using statics::Preference;

// Where there is a response but no history, the report leaves the response out and says so.
void addNote(const model::Arm& arm, json& shown) {
  const std::string note = noteOnResponse(arm);
  if (!note.empty()) shown["notes"] = {note + "; --history follows measured pressures"};
}

// Zones that the arm keeps out of, beside a result.
struct ZoneAnswer {
  clearance::Clearance clearance;
  std::string name;
  std::optional<clearance::Blocked> blocked = {};  // the way there
};

std::optional<clearance::SweepCheck> zonesOf(const io::Scene& scene,
                                             const statics::ArmModel& model) {
  if (!scene.keep_out) return std::nullopt;
  return clearance::SweepCheck(model, *scene.keep_out);
}

ZoneAnswer zoneAt(const clearance::SweepCheck& check, const model::Shape& shape) {
  const clearance::Clearance found = check.clearance().of(shape);
  return {found, check.clearance().nameOf(found.zone)};
}

void addZone(const std::optional<ZoneAnswer>& zone, json& document) {
  if (!zone) return;
  document["clearance_m"] = zone->clearance.distance;
  document["zone"] = textOrNull(zone->name);
}

// ---- forward ------------------------------------------------------------------------------------

constexpr int kMostSamples = 1000000;

struct ForwardOptions {
  std::string scene, inputs, history;
  InputArguments input;
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
  model::ArmResponse response;  // at the inputs
  Eigen::VectorXd measured;     // (n) last row of the history, or the inputs
  int full_rank = lie::SE3::kDof;
  std::vector<json> sections = {};  // {rank, condition, null_space}
  std::vector<model::CurvePoint<lie::SE3>> curve = {};
  std::vector<HistoryRow> rows = {};  // of the history
  std::optional<ZoneAnswer> zone = {};
};

template <class Group>
std::vector<json> sectionsOf(const model::ArmOf<Group>& arm) {
  std::vector<json> sections;
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto& equilibrium = arm.equilibrium(k);
    json null_space = json::array();
    for (int j = 0; j < equilibrium.null_space.cols(); ++j) {
      null_space.push_back(lie::inSpace(typename Group::Tangent(equilibrium.null_space.col(j))));
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
                       model::ArmResponse(model.arm()),
                       inputs};
  if (planar) result.full_rank = lie::SE2::kDof;
  result.sections = planar ? sectionsOf(*model.planar()) : sectionsOf(model.arm());
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

json historyJson(const HistoryRow& row) {
  return {{"time_s", row.time},
          {"pressure_pa", row.pressure},
          {"effective_pressure_pa", row.effective},
          {"memory_known", row.known},
          {"tip", valueIf(row.tip.converged(), row.tip.tip)}};
}

json curveJson(const model::CurvePoint<lie::SE3>& point) {
  json entry = point.X;
  entry["s"] = point.s;
  return entry;
}

json reportOf(const io::Scene& scene, const ForwardResult& result) {
  const statics::TierSetting& setting = result.choice.setting;
  const statics::Solution& solution = result.solution;
  const model::Twists twists = solution.shape.twists();  // means
  json sections = result.sections;
  int rank = result.full_rank;
  double condition = 0;
  for (std::size_t k = 0; k < sections.size(); ++k) {
    rank = std::min(rank, sections[k]["rank"].get<int>());
    condition = std::max(condition, sections[k]["condition"].get<double>());
    const lie::Vector6 twist = twists.col(static_cast<int>(k));
    sections[k].update({{"name", scene.looks[k].name},
                        {"curvature_rad", model::curvatureOf(twist)},
                        {"helix", helixJson(twist)}});
  }
  json document{{"scene", scene.name},
                {"tier", statics::nameOf(setting.tier)},
                {"tier_reason", result.choice.reason},
                {"order", valueIf(setting.order > 0, setting.order)},
                {"tip_error_percent", 100 * result.choice.relative_tip_error},
                {"status", statics::nameOf(solution.status)},
                {"failure", valueIf(!solution.converged(), reasonForNoShape(solution.status))},
                {"relative_residual", solution.residual},
                {"iterations", solution.iterations},
                {"twist", twists.transpose()},
                {"tip", solution.tip},
                {"lengths_m", result.lengths},
                {"rank", rank},
                {"full_rank", result.full_rank},
                {"condition", condition},
                {"sections", sections}};
  addInputs(scene.arm, result.measured, document);
  addResponse(scene.arm, result.response, static_cast<Eigen::Index>(result.rows.size()), document);
  if (!result.rows.empty()) {
    document["effective_pressure_pa"] = result.inputs;
    document["history"] = listJson(result.rows, historyJson);
  }
  addZone(result.zone, document);
  if (solution.shape.piecesPerSection() > 1) {
    document["pieces"] = solution.shape.piecesPerSection();
    document["piece_twist"] = solution.shape.pieces().transpose();
  }
  if (!result.curve.empty()) document["curve"] = listJson(result.curve, curveJson);
  return document;
}

const Columns kForwardColumns = {"tier",
                                 "order",
                                 "status",
                                 "inputs",
                                 {"lengths_m", "length_*_m"},
                                 "twist",
                                 "tip",
                                 "rank",
                                 "condition",
                                 "relative_residual",
                                 "iterations",
                                 "tip_error_percent"};

// The rows of the history, or the curve if it was requested; otherwise one row with all numbers.
void printTable(const io::Scene& scene, const ForwardResult& result, json report,
                std::ostream& out) {
  for (std::size_t k = 0; k < result.rows.size(); ++k) {
    report["history"][k]["status"] = statics::nameOf(result.rows[k].tip.status);
  }
  if (!result.rows.empty()) {
    return printCsv(
        report,
        {{"time_s", "pressure_pa", "effective_pressure_pa", "memory_known", "status", "tip"},
         "history"},
        out);
  }
  if (!result.curve.empty()) {
    return printCsv(report, {{"s", "position_m", "quaternion_xyzw"}, "curve"}, out);
  }
  printCsv(report, {kForwardColumns, "", {}, &scene.arm}, out);
}

// The report without the history, and with what the numbers leave open.
json shownOf(const io::Scene& scene, const ForwardResult& result, json report) {
  report["tier"] = result.choice.setting.name();
  if (!result.rows.empty()) report["history"] = std::to_string(result.rows.size()) + " rows";
  report.erase("order");
  report.erase("piece_twist");
  if (result.rows.empty()) {
    report.erase("response");
    addNote(scene.arm, report);
  }
  return report;
}

// One result per row of a table.
int runRows(const ForwardOptions& options, const GlobalOptions& global, const io::Scene& scene) {
  refuseIf(options.input.given() || !options.history.empty() || options.samples > 0,
           "--inputs excludes --pressure-kpa, --input, --history and --samples");
  const io::DataSet data = tableOf(options.inputs);
  const Eigen::MatrixXd inputs = inputRowsOf(scene, data);
  const statics::ArmModel model = modelOf(scene, options.tier);
  const auto zones = zonesOf(scene, model);
  RowPrinter rows(global.format, scene.name, CsvTable(std::cout, kForwardColumns, &scene.arm),
                  {"status", "tip"});
  bool all_converged = true;
  for (Eigen::Index row = 0; row < inputs.rows(); ++row) {
    ForwardResult result = forward(model, inputs.row(row), 0);
    if (zones && result.solution.converged()) result.zone = zoneAt(*zones, result.solution.shape);
    all_converged = all_converged && result.solution.converged();
    rows.add("line " + std::to_string(data.lines[static_cast<std::size_t>(row)]),
             reportOf(scene, result));
  }
  rows.end();
  return all_converged ? kDone : kNotPossible;
}

int run(const ForwardOptions& options, const GlobalOptions& global) {
  const bool follows = !options.history.empty();
  refuseIf(follows && options.input.given(),
           "--history gives the pressures; leave out --pressure-kpa and --input");
  refuseIf(follows && options.samples > 0 && global.format == Format::kCsv,
           "with --history, csv has the rows of the history; leave out --samples");
  refuseIf(!follows && !options.input.given() && options.inputs.empty(),
           "give --pressure-kpa, --input, --inputs or --history");
  const io::Scene scene = loadScene(options.scene, global);
  if (!options.inputs.empty()) return runRows(options, global, scene);
  const statics::ArmModel model = modelOf(scene, options.tier);
  ForwardResult result =
      follows ? forward(model, historyOfFile(scene, options.history), options.samples)
              : forward(model, inputsOf(scene, options.input), options.samples);
  const auto zones = zonesOf(scene, model);
  if (zones && result.solution.converged()) result.zone = zoneAt(*zones, result.solution.shape);
  const json report = reportOf(scene, result);
  printResult(global.format, report, shownOf(scene, result, report),
              [&](std::ostream& out) { printTable(scene, result, report, out); });
  return result.solution.converged() ? kDone : kNotPossible;
}

// ---- inverse ------------------------------------------------------------------------------------

struct InverseArguments {
  std::string scene, tip, pose, twist, targets, prefer = "min-pressure", history;
  InputArguments start{"--start-kpa", "--start"};
  TierArguments tier;
  std::optional<double> cocontraction;
};

// @param p  (7) position, quaternion xyzw. @param culprit  whose they are.
lie::SE3 poseOf(const std::string& culprit, const Eigen::VectorXd& p) {
  constexpr double kNormTolerance = 1e-3;  // more than the rounding of a few digits
  const Eigen::Quaterniond q(p[6], p[3], p[4], p[5]);
  refuseIf(!(std::abs(q.norm() - 1) <= kNormTolerance), culprit, " has a quaternion of norm ",
           q.norm(), "; expected 1, in the order qx,qy,qz,qw");
  return {q.normalized().toRotationMatrix(), p.head<3>()};
}

statics::InverseOptions optionsOf(const InverseArguments& arguments) {
  statics::InverseOptions options;
  options.preference = statics::preferenceOf(arguments.prefer);
  refuseIf(arguments.cocontraction && options.preference != Preference::kCocontraction,
           "--cocontraction needs --prefer cocontract");
  options.cocontraction = arguments.cocontraction.value_or(options.cocontraction);
  return options;
}

Eigen::VectorXd startOf(const InverseArguments& arguments, const io::Scene& scene) {
  if (arguments.start.given()) return inputsOf(scene, arguments.start);
  const statics::InverseOptions options = optionsOf(arguments);
  const bool cocontracts = options.preference == Preference::kCocontraction;
  return scene.arm.inputAt(cocontracts ? options.cocontraction : 0.0);
}

const char* statusName(InverseStatus status) {
  if (status == InverseStatus::kReached) return "reached";
  return status == InverseStatus::kUnreachable ? "unreachable" : "not_converged";
}

std::string reasonFor(const InverseResult& result) {
  if (result.status == InverseStatus::kReached && std::isfinite(result.residual)) return {};
  if (result.status == InverseStatus::kUnreachable) {
    return basics::format(
        "no inputs within the limits were found to reach the target; the closest leaves a residual "
        "of %g m",
        result.residual);
  }
  if (std::isfinite(result.residual)) {
    return basics::format(
        "the search did not converge; the best inputs found leave a residual of %g m",
        result.residual);
  }
  return "no shape balances the load at any input that was tried; lower the load, or give another "
         "start with --start-kpa";
}

json activeLimits(const model::Arm& arm, const InverseResult& result) {
  json limits = json::array();
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    if (result.limits[i] == Limit::kNone) continue;
    limits.push_back({{"actuator", arm.actuator(i).name},
                      {"limit", result.limits[i] == Limit::kLower ? "lower" : "upper"}});
  }
  return limits;
}

// Result of the search, and the pressures that it takes.
struct InverseAnswer {
  InverseResult result;  // its inputs are effective ones
  statics::TierSetting tier;
  statics::Solution shape;      // at these inputs
  Eigen::VectorXd pressure;     // (n) to command
  model::ArmResponse response;  // before
  Eigen::Index history_rows = 0;
  std::optional<ZoneAnswer> zone = {};

  bool blocked() const { return zone && zone->blocked; }
  bool reached() const { return result.status == InverseStatus::kReached && !blocked(); }
};

// Looks at the zones on the way from where the search began.
InverseAnswer answerOf(const statics::ArmModel& model,
                       const std::optional<clearance::SweepCheck>& zones,
                       const Eigen::VectorXd& start, const InverseResult& result) {
  InverseAnswer answer{result, model.choice().setting, model.solve(result.input), result.input,
                       model::ArmResponse(model.arm())};
  if (zones && answer.shape.converged()) {
    answer.zone = zoneAt(*zones, answer.shape.shape);
    answer.zone->blocked = zones->sweep({start, result.input});
  }
  return answer;
}

json reportOf(const io::Scene& scene, const InverseAnswer& answer) {
  const InverseResult& result = answer.result;
  const statics::Solution& shape = answer.shape;
  json document{{"scene", scene.name},
                {"tier", nameOf(answer.tier.tier)},
                {"order", valueIf(answer.tier.tier == statics::Tier::kLoaded, answer.tier.order)},
                {"status", answer.blocked() ? "blocked" : statusName(result.status)},
                {"reason", textOrNull(reasonFor(result))},
                {"converged", result.converged()},
                {"residual", result.residual},
                {"position_error_m", result.position_error},
                {"active_limits", activeLimits(scene.arm, result)},
                {"iterations", result.iterations},
                {"tip", valueIf(shape.converged(), shape.tip)},
                {"twist", valueIf(shape.converged(), shape.shape.twists().transpose())}};
  addInputs(scene.arm, answer.pressure, document);
  addResponse(scene.arm, answer.response, answer.history_rows, document);
  if (answer.history_rows > 0) document["effective_pressure_pa"] = result.input;
  addZone(answer.zone, document);
  if (answer.blocked()) {
    const clearance::Blocked& blocked = *answer.zone->blocked;
    document["reason"] = "on its way from the start the arm " + blocked.text() +
                         "; plan a way around: helix_arm plan";
    document["blocked_by"] = textOrNull(blocked.zone);
    document["clear_tip"] = nullptr;
    if (blocked.last_clear.size() > 0) {
      document["clear_tip"] = {{"position_m", blocked.clear_tip}};
    }
  }
  return document;
}

const Columns kInverseColumns = {
    "status",        "converged", "inputs", "residual", "position_error_m",
    "active_limits", "twist",     "tip",    "tier",     "order"};

// Names of the columns of positions x_m, y_m, z_m, or, where the table has qx, of poses; with the
// prefix tip_ where the table has those of a result alone.
std::vector<std::string> poseColumns(const io::DataSet& data) {
  const bool printed = data.find("x_m") < 0 && data.find("tip_x_m") >= 0;
  const std::string prefix = printed ? "tip_" : "";
  std::vector<std::string> names;
  for (const char* name : {"x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"}) {
    if (names.size() < 3 || data.find(prefix + "qx") >= 0) names.push_back(prefix + name);
  }
  return names;
}

// Positions, or poses where the table has a quaternion. Each search begins at the start; with
// min-change, at the inputs of the row before.
int runRows(const InverseArguments& arguments, const GlobalOptions& global, const io::Scene& scene,
            const statics::ArmModel& model, statics::InverseSolver& solver) {
  const io::DataSet data = tableOf(arguments.targets);
  const std::vector<std::string> names = poseColumns(data);
  const bool poses = names.size() > 3;
  const Eigen::MatrixXd targets = columnsOf(data, names);
  Eigen::VectorXd start = startOf(arguments, scene);
  const auto zones = zonesOf(scene, model);
  const auto lineOf = [&data](Eigen::Index row) {
    return data.path + ":" + std::to_string(data.lines[static_cast<std::size_t>(row)]);
  };
  // Nothing is printed of a table with a faulty row.
  for (Eigen::Index row = 0; poses && row < targets.rows(); ++row) {
    poseOf(lineOf(row), targets.row(row));
  }
  RowPrinter rows(global.format, scene.name, CsvTable(std::cout, kInverseColumns, &scene.arm),
                  {"status", "reason", "pressure_pa", "input", "active_limits", "residual",
                   "position_error_m", "tip"});
  bool all_reached = true;
  for (Eigen::Index row = 0; row < targets.rows(); ++row) {
    const Eigen::VectorXd target = targets.row(row);
    const std::string line = lineOf(row);
    const InverseAnswer answer = answerOf(
        model, zones, start,
        poses ? solver.toPose(poseOf(line, target), start) : solver.toPosition(target, start));
    all_reached = all_reached && answer.reached();
    if (arguments.prefer == "min-change") start = answer.result.input;
    rows.add(line, reportOf(scene, answer));
  }
  rows.end();
  return all_reached ? kDone : kNotPossible;
}

int run(const InverseArguments& arguments, const GlobalOptions& global) {
  const int targets = !arguments.tip.empty() + !arguments.pose.empty() + !arguments.twist.empty() +
                      !arguments.targets.empty();
  refuseIf(targets != 1, "give exactly one target: --tip, --pose, --twist or --targets");
  const io::Scene scene = loadScene(arguments.scene, global);
  const statics::InverseOptions options = optionsOf(arguments);
  const statics::ArmModel model = modelOf(scene, arguments.tier);
  refuseIf(options.preference == Preference::kStiff && !model.load(),
           "--prefer stiff needs arm.stiffness.K_eps_n in every section; scene ", scene.name,
           " has none");
  statics::InverseSolver solver(model, options);
  if (!arguments.targets.empty()) {
    refuseIf(!arguments.history.empty(), "--targets excludes --history");
    return runRows(arguments, global, scene, model, solver);
  }
  Eigen::VectorXd start = startOf(arguments, scene);
  model::ArmResponse response(scene.arm);
  Eigen::Index rows = 0;
  model::AfterMove after = model::AfterMove::kSlowHeld;
  if (!arguments.history.empty()) {
    const model::InputHistory history = historyOfFile(scene, arguments.history);
    for (; rows < history.rows(); ++rows) response.follow(history, rows);
    // A row after those of a history without times is at rest too.
    if (history.time.empty()) after = model::AfterMove::kAtRest;
    Eigen::VectorXd lower = start, upper = start;
    response.effectiveLimits(scene.arm, lower, upper, after);
    solver.limit(lower, upper);
    start = start.cwiseMax(lower).cwiseMin(upper);
  }

  InverseResult result;
  if (!arguments.tip.empty()) {
    result = solver.toPosition(numberList("--tip", arguments.tip, 3), start);
  } else if (!arguments.pose.empty()) {
    const Eigen::VectorXd pose = numberList("--pose", arguments.pose, 7);
    result = solver.toPose(poseOf("--pose", pose), start);
  } else {
    const int sections = scene.arm.sectionCount();
    const Eigen::VectorXd twists = numberList("--twist", arguments.twist, 6 * sections);
    result = solver.toTwists(twists.reshaped(6, sections), start);
  }
  InverseAnswer answer = answerOf(model, zonesOf(scene, model), start, result);
  answer.response = response;
  answer.history_rows = rows;
  if (rows > 0) response.inputsFor(scene.arm, result.input, answer.pressure, after);
  const json report = reportOf(scene, answer);
  json shown = without(report, {"response", "converged", "order"});
  shown["tier"] = answer.tier.name();
  if (rows == 0) addNote(scene.arm, shown);
  printResult(global.format, report, shown, Csv{kInverseColumns, "", {}, &scene.arm});
  return answer.reached() ? kDone : kNotPossible;
}

}  // namespace

void addForward(Commands& commands) {
  auto [command, options] =
      commands.add<ForwardOptions>("forward", "pressures to the shape and tip of the arm", run);
  addScene(command, options.scene);
  addInputOptions(
      command, options.input, "gauge pressures [kPa], one per actuator: a,b,c",
      "inputs in SI units instead of kPa, one per actuator: pressures [Pa], spool angles [rad]");
  addOption(command, "--inputs", options.inputs,
            "one result per row of this table, or of stdin where it is -: columns pressure_1_kpa "
            ".., pressure_1_pa .. or input_1 .. in SI units");
  addOption(command, "--history", options.history, kHistoryHelp);
  addTierOptions(command, options.tier);
  addOption(command, "--samples", options.samples,
            "also give the curve at N evenly spaced s; s runs over [k, k + 1] along section k",
            CLI::Range(2, kMostSamples));
  command.footer(R"(json: tier, order (of the loaded tier, else null), tier_reason,
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
out), with a slow state rest_time_s}. Of a scene with keep_out: clearance_m, zone (the
nearest).
--tier, --order, --accuracy and --budget replace everything that the scene says about
the tier.
Exit code 1 if no shape balances the load.)");
}

void addInverse(Commands& commands) {
  auto [command, arguments] = commands.add<InverseArguments>(
      "inverse", "a wanted tip, pose or shape to pressures within the limits", run);
  addScene(command, arguments.scene);
  addOption(command, "--tip", arguments.tip, "wanted tip position [m]: x,y,z");
  addOption(command, "--pose", arguments.pose,
            "wanted tip pose [m], unit quaternion: x,y,z,qx,qy,qz,qw");
  addOption(
      command, "--twist", arguments.twist,
      "wanted twists [m, rad]: vx,vy,vz,wx,wy,wz, those of several sections one after the other");
  addOption(command, "--targets", arguments.targets,
            "one result per row of this table, or of stdin where it is -: columns x_m,y_m,z_m and, "
            "for poses, qx,qy,qz,qw; or tip_x_m .. as forward prints them");
  addOption(command, "--prefer", arguments.prefer,
            "which of the inputs that reach the target: min-pressure, min-change (from the start), "
            "cocontract or stiff (least tip compliance)",
            CLI::IsMember(std::vector<std::string>(statics::kPreferenceWords.begin(),
                                                   statics::kPreferenceWords.end())),
            kShowDefault);
  addInputOptions(
      command, arguments.start,
      "start of the search, gauge pressures [kPa]: a,b,c; default: lower limits, with "
      "cocontract at its fraction",
      "start of the search in SI units instead of kPa: pressures [Pa], spool angles [rad]");
  addOption(command, "--history", arguments.history,
            std::string(kHistoryHelp) + ", and the pressures continue from there");
  addTierOptions(command, arguments.tier);
  addOption(command, "--cocontraction", arguments.cocontraction,
            "with cocontract: wanted fraction of each actuator's range, default 0.5",
            CLI::Range(0.0, 1.0));
  command.footer(
      R"(json: tier, order (of the loaded tier, else null), pressure_pa, actuators, status
(reached, unreachable, not_converged), reason (null if reached), converged, residual
(position error and, for poses and twists, 0.1 m per rad of rotation [m]),
position_error_m, active_limits [{actuator, limit}], iterations, and the tip and twist
(mean of each section) reached.
With --targets json is {scene, rows [as above]}, csv has a row for each target.
With --history the pressures are those to go to in one direction from its last row, for the
effective_pressure_pa that reach the target; response as in `forward`.
Of a scene with keep_out: clearance_m and zone at the result; status blocked (exit code 1)
where the arm would come too close on the straight way of the pressures from the start:
blocked_by, clear_tip {position_m} (the last on that way; null if the start is too close).
An unreachable target gives the closest inputs found and exit code 1.)");
}

}  // namespace helix_arm::cli
