// Pressures to the shape of the arm (forward), and a wanted tip, pose or shape to pressures
// (inverse).
#include <Eigen/Geometry>
#include <algorithm>

#include "basics/text.hpp"
#include "command.hpp"
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

using Zones = std::optional<clearance::SweepCheck>;

Zones zonesOf(const io::Scene& scene, const statics::ArmModel& model) {
  if (!scene.keep_out) return std::nullopt;
  return clearance::SweepCheck(model, *scene.keep_out);
}

// Adds the zone that is nearest to a shape.
void addZone(const Zones& zones, const statics::Solution& solution, json& document) {
  if (!zones || !solution.converged()) return;
  const clearance::Clearance found = zones->clearance().of(solution.shape);
  document["clearance_m"] = found.distance;
  document["zone"] = textOrNull(zones->clearance().nameOf(found.zone));
}

// ---- forward ------------------------------------------------------------------------------------

constexpr int kMostSamples = 1000000;

struct ForwardOptions {
  std::string scene, inputs, history;
  InputArguments input;
  TierArguments tier;
  int samples = 0;
};

template <class Group>
json sectionsOf(const model::ArmOf<Group>& arm) {
  json sections = json::array();
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

json helixJson(const lie::Vector6& twist) {
  constexpr double kStraight = 1e-12;  // below it, a curvature is rounding error [rad]
  if (twist.tail<3>().norm() < kStraight) {
    return {{"radius_m", nullptr}, {"pitch_m", 0.0}, {"turns", 0.0}};
  }
  const model::Helix helix = model::helixOf(twist);
  return {{"radius_m", helix.radius}, {"pitch_m", helix.pitch}, {"turns", helix.turns}};
}

json curveJson(const model::CurvePoint<lie::SE3>& point) {
  json entry = point.X;
  entry["s"] = point.s;
  return entry;
}

// The report of a scene's arm.
struct Forward {
  const io::Scene& scene;
  statics::ArmModel model;
  int samples = 0;  // of the curve
  Zones zones = zonesOf(scene, model);

  json at(const Eigen::VectorXd& inputs) const;
  // The shape is that at the last row. Each row has the `status` of its tip, for csv.
  json after(const model::InputHistory& history) const;

 private:
  // At inputs, which are effective pressures.
  json shapeAt(const Eigen::VectorXd& inputs) const;
};

json Forward::shapeAt(const Eigen::VectorXd& inputs) const {
  const statics::TierChoice& choice = model.choice();
  const statics::TierSetting& setting = choice.setting;
  const bool planar = setting.tier == statics::Tier::kPlanar;
  const statics::Solution solution = model.solve(inputs);
  const model::Twists twists = solution.shape.twists();  // means
  json sections = planar ? sectionsOf(*model.planar()) : sectionsOf(model.arm());
  int rank = planar ? lie::SE2::kDof : lie::SE3::kDof;
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
                {"tier_reason", choice.reason},
                {"order", valueIf(setting.order > 0, setting.order)},
                {"tip_error_percent", 100 * choice.relative_tip_error},
                {"status", statics::nameOf(solution.status)},
                {"failure", valueIf(!solution.converged(), reasonForNoShape(solution.status))},
                {"relative_residual", solution.residual},
                {"iterations", solution.iterations},
                {"twist", twists.transpose()},
                {"tip", solution.tip},
                {"lengths_m", model.arm().lengths(inputs)},
                {"rank", rank},
                {"full_rank", planar ? lie::SE2::kDof : lie::SE3::kDof},
                {"condition", condition},
                {"sections", sections}};
  addZone(zones, solution, document);
  if (solution.shape.piecesPerSection() > 1) {
    document["pieces"] = solution.shape.piecesPerSection();
    document["piece_twist"] = solution.shape.pieces().transpose();
  }
  if (samples > 0) document["curve"] = listJson(model.curve(inputs, samples), curveJson);
  return document;
}

json Forward::at(const Eigen::VectorXd& inputs) const {
  json document = shapeAt(inputs);
  addInputs(scene.arm, inputs, document);
  addResponse(scene.arm, model::ArmResponse(scene.arm), 0, document);
  return document;
}

json Forward::after(const model::InputHistory& history) const {
  model::ArmResponse response(model.arm());
  json rows = json::array();
  Eigen::VectorXd effective;
  for (Eigen::Index k = 0; k < history.rows(); ++k) {
    response.follow(history, k);
    effective = model.arm().clamped(response.effective());
    const statics::Tip tip = model.tip(effective);
    rows.push_back({{"time_s", nullptr},
                    {"pressure_pa", history.input.row(k)},
                    {"effective_pressure_pa", effective},
                    {"memory_known", response.known()},
                    {"status", statics::nameOf(tip.status)},
                    {"tip", valueIf(tip.converged(), tip.tip)}});
    if (!history.time.empty()) rows.back()["time_s"] = history.time[static_cast<std::size_t>(k)];
  }
  json document = shapeAt(effective);
  addInputs(scene.arm, history.input.row(history.rows() - 1), document);
  addResponse(scene.arm, response, history.rows(), document);
  document["effective_pressure_pa"] = effective;
  document["history"] = rows;
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
Csv csvOf(const io::Scene& scene, const json& report) {
  if (report.contains("history")) {
    return {{"time_s", "pressure_pa", "effective_pressure_pa", "memory_known", "status", "tip"},
            "history"};
  }
  if (report.contains("curve")) return {{"s", "position_m", "quaternion_xyzw"}, "curve"};
  return {kForwardColumns, "", {}, &scene.arm};
}

// The report without the history, and with what the numbers leave open.
json shownOf(const Forward& forward, json report) {
  report["tier"] = forward.model.choice().setting.name();
  report.erase("order");
  report.erase("piece_twist");
  if (report.contains("history")) {
    report["history"] = std::to_string(report["history"].size()) + " rows";
  } else {
    report.erase("response");
    addNote(forward.scene.arm, report);
  }
  return report;
}

// One result per row of a table.
int runRows(const ForwardOptions& options, Format format, const Forward& forward) {
  refuseIf(options.input.given() || !options.history.empty() || options.samples > 0,
           "--inputs excludes --pressure-kpa, --input, --history and --samples");
  const io::Scene& scene = forward.scene;
  const io::DataSet data = tableOf(options.inputs);
  const Eigen::MatrixXd inputs = inputRowsOf(scene, data);
  RowPrinter rows(format, scene.name, CsvTable(std::cout, kForwardColumns, &scene.arm),
                  {"status", "tip"});
  bool all_converged = true;
  for (Eigen::Index row = 0; row < inputs.rows(); ++row) {
    const json report = forward.at(inputs.row(row));
    all_converged = all_converged && report["failure"].is_null();
    rows.add("line " + std::to_string(data.lines[static_cast<std::size_t>(row)]), report);
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
  const Forward forward{scene, modelOf(scene, options.tier), options.samples};
  if (!options.inputs.empty()) return runRows(options, global.format, forward);
  json report = follows ? forward.after(historyOfFile(scene, options.history))
                        : forward.at(inputsOf(scene, options.input));
  const auto print = [&scene, table = report](std::ostream& out) {
    printCsv(table, csvOf(scene, table), out);
  };
  if (follows) {
    for (json& row : report["history"]) row.erase("status");
  }
  printResult(global.format, report, shownOf(forward, report), print);
  return report["failure"].is_null() ? kDone : kNotPossible;
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

// The report of a search that began at these inputs.
json reportOf(const io::Scene& scene, const statics::ArmModel& model, const Zones& zones,
              const Eigen::VectorXd& start, const InverseResult& result) {
  const statics::TierSetting& tier = model.choice().setting;
  const statics::Solution found = model.solve(result.input);
  json document{{"scene", scene.name},
                {"tier", nameOf(tier.tier)},
                {"order", valueIf(tier.tier == statics::Tier::kLoaded, tier.order)},
                {"status", statusName(result.status)},
                {"reason", textOrNull(reasonFor(result))},
                {"converged", result.converged()},
                {"residual", result.residual},
                {"position_error_m", result.position_error},
                {"active_limits", activeLimits(scene.arm, result)},
                {"iterations", result.iterations},
                {"tip", valueIf(found.converged(), found.tip)},
                {"twist", valueIf(found.converged(), found.shape.twists().transpose())}};
  addInputs(scene.arm, result.input, document);
  addResponse(scene.arm, model::ArmResponse(scene.arm), 0, document);
  addZone(zones, found, document);
  if (!zones || !found.converged()) return document;
  if (const auto blocked = zones->sweep({start, result.input})) {
    document["status"] = "blocked";
    document["reason"] = "on its way from the start the arm " + blocked->text() +
                         "; plan a way around: helix_arm plan";
    document["blocked_by"] = textOrNull(blocked->zone);
    document["clear_tip"] = nullptr;
    if (blocked->last_clear.size() > 0) {
      document["clear_tip"] = {{"position_m", blocked->clear_tip}};
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
    const InverseResult result =
        poses ? solver.toPose(poseOf(line, target), start) : solver.toPosition(target, start);
    const json report = reportOf(scene, model, zones, start, result);
    all_reached = all_reached && report["status"] == "reached";
    if (arguments.prefer == "min-change") start = result.input;
    rows.add(line, report);
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
  json report = reportOf(scene, model, zonesOf(scene, model), start, result);
  if (rows > 0) {
    Eigen::VectorXd pressure = result.input;
    response.inputsFor(scene.arm, result.input, pressure, after);
    addInputs(scene.arm, pressure, report);
    addResponse(scene.arm, response, rows, report);
    report["effective_pressure_pa"] = result.input;
  }
  json shown = without(report, {"response", "converged", "order"});
  shown["tier"] = model.choice().setting.name();
  if (rows == 0) addNote(scene.arm, shown);
  printResult(global.format, report, shown, Csv{kInverseColumns, "", {}, &scene.arm});
  return report["status"] == "reached" ? kDone : kNotPossible;
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
