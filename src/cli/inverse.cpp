#include "helix_arm/statics/inverse.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <memory>

#include "arguments.hpp"
#include "command.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/model/curve.hpp"
#include "measurements.hpp"
#include "output.hpp"

namespace helix_arm::cli {
namespace {

using nlohmann::json;
using statics::InverseResult;
using statics::InverseStatus;
using statics::Limit;
using statics::Preference;

struct InverseArguments {
  std::string scene, tip, pose, twist, targets, prefer = "min-pressure", start_kpa, start, history;
  TierArguments tier;
  double cocontraction = 0.5;
  bool cocontraction_given = false;
};

// @param p  (7) position, quaternion xyzw. @param culprit  whose they are.
// Position, then the quaternion x, y, z, w. Its norm is an error if it is not 1; a cell of a file
// is not repeated.
lie::SE3 poseOf(const std::string& culprit, const Eigen::VectorXd& p, bool repeat_norm) {
  constexpr double kNormTolerance = 1e-3;  // more than the rounding of a few digits
  const Eigen::Quaterniond q(p[6], p[3], p[4], p[5]);
  if (!(std::abs(q.norm() - 1) <= kNormTolerance)) {
    throw CallerError(culprit + " has a quaternion of " +
                      (repeat_norm ? basics::format("norm %g", q.norm()) : "another norm") +
                      "; expected 1, in the order qx,qy,qz,qw");
  }
  return {q.normalized().toRotationMatrix(), {p[0], p[1], p[2]}};
}

lie::SE3 poseArgument(const std::string& text) {
  const std::vector<double> p = numberList("--pose", text, 7);
  return poseOf("--pose", Eigen::Map<const Eigen::VectorXd>(p.data(), 7), true);
}

model::Twists twistArgument(const std::string& text, int sections) {
  const std::vector<double> numbers =
      numberList("--twist", text, 6 * static_cast<std::size_t>(sections));
  return Eigen::Map<const Eigen::MatrixXd>(numbers.data(), 6, sections);
}

statics::InverseOptions optionsOf(const InverseArguments& arguments) {
  statics::InverseOptions options;
  options.preference = statics::preferenceOf(arguments.prefer);
  if (arguments.cocontraction_given && options.preference != Preference::kCocontraction) {
    throw CallerError("--cocontraction needs --prefer cocontract");
  }
  options.cocontraction = arguments.cocontraction;
  return options;
}

Eigen::VectorXd startOf(const InverseArguments& arguments, const io::Scene& scene) {
  if (!arguments.start_kpa.empty() || !arguments.start.empty()) {
    return inputsOf(scene, "--start-kpa", arguments.start_kpa, "--start", arguments.start);
  }
  return scene.arm.inputAt(arguments.prefer == "cocontract" ? arguments.cocontraction : 0.0);
}

const char* statusName(InverseStatus status) {
  if (status == InverseStatus::kReached) return "reached";
  return status == InverseStatus::kUnreachable ? "unreachable" : "not_converged";
}

const char* limitName(Limit limit) { return limit == Limit::kLower ? "lower" : "upper"; }

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
    limits.push_back({{"actuator", arm.actuator(i).name}, {"limit", limitName(result.limits[i])}});
  }
  return limits;
}

// What the search found, and the pressures that it takes.
struct InverseAnswer {
  InverseResult result;         // its inputs are effective ones
  Eigen::VectorXd pressure;     // (n) to command
  model::ArmResponse response;  // before
  Eigen::Index history_rows = 0;
};

// What a row of csv has besides numbers; tables of many rows build no more of the report.
json summaryOf(const io::Scene& scene, const statics::TierSetting& tier,
               const InverseAnswer& answer) {
  return {{"tier", nameOf(tier.tier)},
          {"order", tier.tier == statics::Tier::kLoaded ? json(tier.order) : json()},
          {"status", statusName(answer.result.status)},
          {"converged", answer.result.converged()},
          {"active_limits", activeLimits(scene.arm, answer.result)}};
}

json reportOf(const io::Scene& scene, const statics::TierSetting& tier, const InverseAnswer& answer,
              const statics::Solution& reached) {
  const InverseResult& result = answer.result;
  json document = summaryOf(scene, tier, answer);
  document.update({{"scene", scene.name},
                   {"reason", textOrNull(reasonFor(result))},
                   {"residual", finite(result.residual)},
                   {"position_error_m", finite(result.position_error)},
                   {"iterations", result.iterations},
                   {"tip", reached.converged() ? toJson(reached.tip) : json()},
                   {"twist", reached.converged() ? toJson(reached.shape.twists()) : json()}});
  addInputs(scene.arm, answer.pressure, document);
  addResponse(scene.arm, answer.response, answer.history_rows, document);
  if (answer.history_rows > 0) document["effective_pressure_pa"] = toJson(result.input);
  return document;
}

CsvTable::Row rowOf(const io::Scene& scene, const statics::TierSetting& tier,
                    const InverseAnswer& answer, const statics::Solution& reached) {
  const json summary = summaryOf(scene, tier, answer);
  CsvTable::Row row = cellsOf(summary, {"status", "converged"});
  appendInputs(scene.arm, answer.pressure, row);
  row.emplace_back("residual", exact(answer.result.residual));
  row.emplace_back("position_error_m", exact(answer.result.position_error));
  std::string limits;  // one cell: actuator=limit, separated by spaces
  for (const json& limit : summary["active_limits"]) {
    limits += (limits.empty() ? "" : " ") + limit["actuator"].get<std::string>() + "=" +
              limit["limit"].get<std::string>();
  }
  row.emplace_back("active_limits", limits);
  appendTwists(toJson(reached.shape.twists()), scene.arm.sectionCount(), row);
  appendPose("tip_", toJson(reached.tip), row);
  for (auto& cell : cellsOf(summary, {"tier", "order"})) row.push_back(std::move(cell));
  return row;
}

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
  const statics::TierSetting& tier = model.choice().setting;
  Eigen::VectorXd start = startOf(arguments, scene);
  const auto lineOf = [&data](Eigen::Index row) {
    return data.path + ":" + std::to_string(data.lines[static_cast<std::size_t>(row)]);
  };
  // Nothing is printed of a table with a faulty row.
  for (Eigen::Index row = 0; poses && row < targets.rows(); ++row) {
    poseOf(lineOf(row), targets.row(row), false);
  }
  RowPrinter rows(global.format, scene.name);
  bool all_reached = true;
  for (Eigen::Index row = 0; row < targets.rows(); ++row) {
    const Eigen::VectorXd target = targets.row(row);
    const std::string line = lineOf(row);
    const InverseResult result = poses ? solver.toPose(poseOf(line, target, false), start)
                                       : solver.toPosition(target, start);
    const InverseAnswer answer{result, result.input, model::ArmResponse(scene.arm)};
    const statics::Solution reached = model.solve(result.input);
    all_reached = all_reached && result.status == InverseStatus::kReached;
    if (arguments.prefer == "min-change") start = result.input;
    rows.add(
        line, [&] { return reportOf(scene, tier, answer, reached); },
        [&] { return rowOf(scene, tier, answer, reached); },
        {"status", "reason", "pressure_pa", "input", "active_limits", "residual",
         "position_error_m", "tip"});
  }
  rows.end();
  return all_reached ? kDone : kNotPossible;
}

int run(const InverseArguments& arguments, const GlobalOptions& global) {
  const int targets = !arguments.tip.empty() + !arguments.pose.empty() + !arguments.twist.empty() +
                      !arguments.targets.empty();
  if (targets != 1)
    throw CallerError("give exactly one target: --tip, --pose, --twist or --targets");
  const io::Scene scene = loadScene(arguments.scene, global);
  const statics::InverseOptions options = optionsOf(arguments);
  const statics::ArmModel model = modelOf(scene, arguments.tier);
  if (options.preference == Preference::kStiff && !model.load()) {
    throw CallerError("--prefer stiff needs arm.stiffness.K_eps_n in every section; scene " +
                      scene.name + " has none");
  }
  statics::InverseSolver solver(model, options);
  if (!arguments.targets.empty()) {
    if (!arguments.history.empty()) throw CallerError("--targets excludes --history");
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
    const std::vector<double> p = numberList("--tip", arguments.tip, 3);
    result = solver.toPosition({p[0], p[1], p[2]}, start);
  } else if (!arguments.pose.empty()) {
    result = solver.toPose(poseArgument(arguments.pose), start);
  } else {
    result = solver.toTwists(twistArgument(arguments.twist, scene.arm.sectionCount()), start);
  }
  InverseAnswer answer{result, result.input, response, rows};
  if (rows > 0) response.inputsFor(scene.arm, result.input, answer.pressure, after);
  const statics::Solution reached = model.solve(result.input);
  const statics::TierSetting& tier = model.choice().setting;
  const json report = reportOf(scene, tier, answer, reached);
  json shown = without(report, {"response", "converged", "order"});
  shown["tier"] = tier.name();
  const std::string note = noteOnResponse(scene.arm);
  if (rows == 0 && !note.empty()) {
    shown["notes"] = {note + "; --history follows measured pressures"};
  }
  printResult(
      global.format, report, [&] { return rowOf(scene, tier, answer, reached); }, shown);
  return result.status == InverseStatus::kReached ? kDone : kNotPossible;
}

}  // namespace

Subcommand addInverse(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("inverse", "a wanted tip, pose or shape to pressures within the limits");
  const auto arguments = std::make_shared<InverseArguments>();
  addScene(*command, "SCENE", arguments->scene, "scene file")->required();
  addOption(*command, "--tip", arguments->tip, "wanted tip position [m]: x,y,z");
  addOption(*command, "--pose", arguments->pose,
            "wanted tip pose [m], unit quaternion: x,y,z,qx,qy,qz,qw");
  addOption(
      *command, "--twist", arguments->twist,
      "wanted twists [m, rad]: vx,vy,vz,wx,wy,wz, those of several sections one after the other");
  addOption(*command, "--targets", arguments->targets,
            "one result per row of this table, or of stdin where it is -: columns x_m,y_m,z_m and, "
            "for poses, qx,qy,qz,qw; or tip_x_m .. as forward prints them");
  addOption(*command, "--prefer", arguments->prefer,
            "which of the inputs that reach the target: min-pressure, min-change (from the start), "
            "cocontract or stiff (least tip compliance)",
            CLI::IsMember(std::vector<std::string>(statics::kPreferenceWords.begin(),
                                                   statics::kPreferenceWords.end())),
            kShowDefault);
  addOption(*command, "--start-kpa", arguments->start_kpa,
            "start of the search, gauge pressures [kPa]: a,b,c; default: lower limits, with "
            "cocontract at its fraction");
  addOption(*command, "--start", arguments->start,
            "start of the search in SI units instead of kPa: pressures [Pa], spool angles [rad]");
  addOption(*command, "--history", arguments->history,
            std::string(kHistoryHelp) + ", and the pressures continue from there");
  addTierOptions(*command, arguments->tier);
  CLI::Option* cocontraction =
      addOption(*command, "--cocontraction", arguments->cocontraction,
                "with cocontract: wanted fraction of each actuator's range", CLI::Range(0.0, 1.0),
                kShowDefault);
  command->footer(
      R"(json: tier, order (of the loaded tier, else null), pressure_pa, actuators, status
(reached, unreachable, not_converged), reason (null if reached), converged, residual
(position error and, for poses and twists, 0.1 m per rad of rotation [m]),
position_error_m, active_limits [{actuator, limit}], iterations, and the tip and twist
(mean of each section) reached.
With --targets json is {scene, rows [as above]}, csv has a row for each target.
With --history the pressures are those to go to in one direction from its last row, for the
effective_pressure_pa that reach the target; response as in `forward`.
An unreachable target gives the closest inputs found and exit code 1.)");
  return {command, [arguments, cocontraction](const GlobalOptions& global) {
            arguments->cocontraction_given = cocontraction->count() > 0;
            return run(*arguments, global);
          }};
}

}  // namespace helix_arm::cli
