// How much the tip carries at a place, and whether a shape can be held under a load.
#include "helix_arm/statics/payload.hpp"

#include <algorithm>
#include <cstdint>
#include <future>
#include <thread>

#include "basics/median.hpp"
#include "basics/text.hpp"
#include "command.hpp"
#include "helix_arm/statics/attain.hpp"
#include "helix_arm/statics/workspace.hpp"
#include "procedures/report_plot.hpp"

namespace helix_arm::cli {
namespace {

using statics::Limit;
using statics::Payload;
using statics::PayloadEnd;

constexpr model::Range kTolerancePercent{1e-3, 100};

void requireStiffness(const io::Scene& scene, const char* command) {
  refuseIf(!scene.model.load(), command, " needs arm.stiffness.K_eps_n in every section; scene ",
           scene.name, " has none: add the extensional stiffness of one actuator [N]");
}

// ---- payload ------------------------------------------------------------------------------------

struct PayloadArguments {
  std::string scene, tip, direction, moment, png;
  bool map = false;
  int count = 4000;
  std::uint64_t seed = 1;
  double tolerance_percent = 1.0;
};

// The weight's direction, base frame.
Eigen::Vector3d downIn(const io::Scene& scene) {
  const Eigen::Vector3d& gravity = scene.model.load()->gravity;
  return gravity.isZero(0) ? -scene.X_WB.rotation.row(2).transpose() : gravity.normalized();
}

json payloadJson(const model::Arm& arm, const Eigen::Vector3d& direction, const Payload& found) {
  const bool held = found.end != PayloadEnd::kUnreached;
  return {{"direction", direction},
          {"force_n", valueIf(held, found.force)},
          {"limit", found.end == PayloadEnd::kLimits ? limitsText(arm, found.limits)
                                                     : std::string(nameOf(found.end))},
          {"stiffness_n_per_m", found.stiffness},
          {"pressures_pa", found.input}};
}

statics::PayloadOptions optionsOf(const PayloadArguments& arguments) {
  statics::PayloadOptions options;
  options.position_tolerance = arguments.tolerance_percent / 100;
  if (!arguments.moment.empty()) options.moment = numberList("--moment", arguments.moment, 3);
  return options;
}

json headOf(const io::Scene& scene, const statics::PayloadSolver& solver) {
  const statics::TierSetting& tier = solver.model().choice().setting;
  return {{"scene", scene.name},
          {"tier", statics::nameOf(tier.tier)},
          {"order", tier.order > 0 ? json(tier.order) : json()},
          {"tolerance_m", solver.positionTolerance()}};
}

std::vector<Eigen::Vector3d> directionsOf(const io::Scene& scene, const std::string& given) {
  if (given == "down") return {downIn(scene)};
  std::vector<Eigen::Vector3d> out;
  if (given.empty()) {
    for (const auto& direction : statics::payloadDirections().colwise()) out.push_back(direction);
  } else {
    const Eigen::VectorXd one = numberList("--direction", given, 3);
    refuseIf(one.isZero(0), "--direction is 0; expected another vector, or down");
    out.push_back(one.normalized());
  }
  return out;
}

// Adds the weakest and the strongest of the rows, null without any.
void addEnds(const json& rows, json& report) {
  const auto weaker = [](const json& a, const json& b) { return a["force_n"] < b["force_n"]; };
  const bool some = !rows.empty();
  report["weakest"] = some ? *std::min_element(rows.begin(), rows.end(), weaker) : json();
  report["strongest"] = some ? *std::max_element(rows.begin(), rows.end(), weaker) : json();
}

int runTip(const PayloadArguments& arguments, const GlobalOptions& global, const io::Scene& scene) {
  refuseIf(!arguments.png.empty(), "--png draws a map; give --map instead of --tip");
  statics::PayloadSolver solver(scene.model, optionsOf(arguments));
  const Eigen::Vector3d tip = numberList("--tip", arguments.tip, 3);
  const std::vector<Eigen::Vector3d> directions = directionsOf(scene, arguments.direction);
  const statics::InverseResult without_force = solver.moveTo(tip);
  json rows = json::array();
  const bool there = solver.isThere();
  for (const Eigen::Vector3d& direction : directions) {
    if (there) rows.push_back(payloadJson(scene.arm, direction, solver.along(direction)));
  }
  json report = headOf(scene, solver);
  report.update({{"tip_m", tip},
                 {"status", there ? "reached" : "unreached"},
                 {"reason", nullptr},
                 {"position_error_m", without_force.position_error},
                 {"pressures_pa", without_force.input},
                 {"directions", rows}});
  addEnds(rows, report);
  if (!there) {
    report["reason"] = basics::format(
        "without the force the tip comes no nearer than %.3g m; choose a place within the "
        "workspace, or a larger --tolerance",
        without_force.position_error);
  }
  json shown = without(report, {"order"});
  for (const char* key : {"weakest", "strongest"}) {
    shown[key] = without(shown[key], {"pressures_pa", "stiffness_n_per_m"});
    if (rows.size() < 2) shown.erase(key);
  }
  printResult(global.format, report, shown,
              Csv{{{"direction", "direction_@"}, "force_n", "limit", "stiffness_n_per_m", "inputs"},
                  "directions",
                  {},
                  &scene.arm});
  return there ? kDone : kNotPossible;
}

// ---- payload --map ------------------------------------------------------------------------------

// Many places, and what each carries downwards.
struct PayloadMap {
  Eigen::MatrixX3d tips;
  std::vector<Payload> found;  // one for each
};

PayloadMap mapOf(const io::Scene& scene, const PayloadArguments& arguments,
                 const statics::PayloadSolver& solver) {
  const statics::Workspace workspace(solver.model(), {arguments.seed, false});
  PayloadMap map{workspace.sample(0, arguments.count).tips, {}};
  map.found.resize(static_cast<std::size_t>(map.tips.rows()));
  const Eigen::Vector3d down = downIn(scene);
  const int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  std::vector<std::future<void>> work;
  for (int thread = 0; thread < threads; ++thread) {
    work.push_back(std::async(std::launch::async, [&, thread] {
      statics::PayloadSolver own(scene.model, optionsOf(arguments));
      for (Eigen::Index k = thread; k < map.tips.rows() && !interrupted(); k += threads) {
        own.moveTo(map.tips.row(k));
        map.found[static_cast<std::size_t>(k)] = own.along(down);
      }
    }));
  }
  for (std::future<void>& one : work) one.get();
  return map;
}

// The points as `plot_report` reads them.
std::string cloudOf(const PayloadMap& map) {
  std::string out = "ply\nformat binary_little_endian 1.0\nelement vertex " +
                    std::to_string(map.found.size()) + "\n";
  for (const char* name : {"x", "y", "z", "payload_n"}) {
    out += std::string("property float ") + name + "\n";
  }
  out += "end_header\n";
  for (std::size_t k = 0; k < map.found.size(); ++k) {
    const Eigen::Vector3f tip = map.tips.row(static_cast<Eigen::Index>(k)).cast<float>();
    const float numbers[] = {tip.x(), tip.y(), tip.z(), static_cast<float>(map.found[k].force)};
    out.append(reinterpret_cast<const char*>(numbers), sizeof numbers);
  }
  return out;
}

int runMap(const PayloadArguments& arguments, const GlobalOptions& global, const io::Scene& scene) {
  refuseIf(!arguments.direction.empty(),
           "--map tells what places carry downwards; leave out "
           "--direction");
  requireWritable({arguments.png});
  const statics::PayloadSolver solver(scene.model, optionsOf(arguments));
  PayloadMap map;
  {
    const InterruptWatch watch;
    map = mapOf(scene, arguments, solver);
    if (interrupted()) return kInterrupted;
  }
  json report = headOf(scene, solver);
  json rows = json::array();
  std::vector<double> forces;
  for (std::size_t k = 0; k < map.found.size(); ++k) {
    rows.push_back(payloadJson(scene.arm, downIn(scene), map.found[k]));
    rows.back()["tip_m"] = map.tips.row(static_cast<Eigen::Index>(k));
    forces.push_back(map.found[k].force);
  }
  const bool some = !rows.empty();
  report.update({{"direction", downIn(scene)},
                 {"count", rows.size()},
                 {"median_n", some ? json(basics::medianOf(forces)) : json()},
                 {"reason", valueIf(!some, "no shape balances the load at any sampled input")},
                 {"png", textOrNull(arguments.png)}});
  addEnds(rows, report);
  if (!arguments.png.empty() && some) {
    const json drawn{{"scene", scene.name}, {"tier", ""}, {"cloud", "cloud.ply"}};
    procedures::drawReport(drawn.dump(), arguments.png, "leave out --png",
                           {"cloud.ply", cloudOf(map)});
  }
  const Csv csv{{{"tip_m", "@_m"}, "force_n", "limit", "stiffness_n_per_m", "pressures_pa"},
                "rows"};
  printResult(global.format, report, without(report, {"order"}), [&](std::ostream& out) {
    printCsv({{"rows", rows}}, csv, out);
  });
  return some ? kDone : kNotPossible;
}

int run(const PayloadArguments& arguments, const GlobalOptions& global) {
  refuseIf(arguments.map == !arguments.tip.empty(), "give either --tip or --map");
  const io::Scene scene = loadScene(arguments.scene, global);
  requireStiffness(scene, "payload");
  return arguments.map ? runMap(arguments, global, scene) : runTip(arguments, global, scene);
}

// ---- attain -------------------------------------------------------------------------------------

struct AttainArguments {
  std::string scene, twists;
  std::vector<std::string> forces, moments;
  double tolerance_percent = 100 * statics::AttainSolver::kUsualTolerance;
};

std::vector<statics::PointLoad> pointsOf(const AttainArguments& arguments, const model::Arm& arm) {
  std::vector<statics::PointLoad> out;
  for (const std::string& text : arguments.forces) {
    const Eigen::VectorXd numbers = numberList("--force", text, 4);
    out.push_back(statics::placeAt(arm, numbers[0]));
    out.back().force = numbers.tail<3>();
  }
  for (const std::string& text : arguments.moments) {
    const Eigen::VectorXd numbers = numberList("--moment", text, 4);
    out.push_back(statics::placeAt(arm, numbers[0]));
    out.back().moment = numbers.tail<3>();
  }
  return out;
}

model::Shape shapeOf(const AttainArguments& arguments, const model::Arm& arm) {
  const int numbers = static_cast<int>(wordsOf(arguments.twists + ",").size());
  const int row = 6 * arm.sectionCount(), pieces = numbers / row;
  refuseIf(numbers == 0 || numbers % row != 0 || pieces * arm.sectionCount() > model::kMaxPieces,
           "--twists has ", numbers, " values; expected ", row, ", 6 for each of ",
           arm.sectionCount(), " sections, or a multiple of that, for each of its pieces");
  const Eigen::VectorXd twists = numberList("--twists", arguments.twists, numbers);
  return {model::Shape::Pieces(twists.reshaped(6, numbers / 6)), pieces, arm.links()};
}

int run(const AttainArguments& arguments, const GlobalOptions& global) {
  const io::Scene scene = loadScene(arguments.scene, global);
  requireStiffness(scene, "attain");
  const statics::AttainSolver solver(scene.arm, *scene.model.load(),
                                     arguments.tolerance_percent / 100);
  const statics::Attainment found =
      solver.attain(shapeOf(arguments, scene.arm), pointsOf(arguments, scene.arm));
  const std::string limits = limitsText(scene.arm, found.limits);
  json report{{"scene", scene.name},
              {"attainable", found.attainable},
              {"missing",
               {{"s", found.missing.section + found.missing.s},
                {"force_n", found.missing.force},
                {"moment_nm", found.missing.moment}}},
              {"limit", textOrNull(limits)},
              {"residual_n", found.residual},
              {"largest_force_n", solver.largestForce()},
              {"pressures_pa", found.input},
              {"reason", nullptr}};
  if (!found.attainable) {
    report["reason"] =
        limits.empty()
            ? "no actuator makes the missing wrench at any pressure: the shape itself has to change"
            : "the missing wrench needs actuators beyond their limits";
  }
  printResult(global.format, report, report,
              Csv{{"attainable",
                   "residual_n",
                   "largest_force_n",
                   "limit",
                   {"missing/s", "missing_s"},
                   {"missing/force_n", "missing_force_*_n"},
                   {"missing/moment_nm", "missing_moment_*_nm"},
                   "inputs"},
                  "",
                  {},
                  &scene.arm});
  return found.attainable ? kDone : kNotPossible;
}

}  // namespace

void addPayload(Commands& commands) {
  auto [command, arguments] = commands.add<PayloadArguments>(
      "payload", "the largest force that the tip carries at a place", run);
  addScene(command, arguments.scene);
  addOption(command, "--tip", arguments.tip, "place of the tip [m]: x,y,z");
  addOption(command, "--direction", arguments.direction,
            "of the force, base frame: dx,dy,dz, or down; default: 26 directions");
  addOption(command, "--moment", arguments.moment, "also acts on the tip [N m]: mx,my,mz");
  addOption(command, "--tolerance", arguments.tolerance_percent,
            "distance up to which the tip counts as there [% of the arm's length]",
            TypeName{"PERCENT"}, within(kTolerancePercent), kShowDefault);
  command.add_flag("--map", arguments.map,
                   "instead of one place: what sampled places of the workspace carry downwards");
  addOption(command, "--png", arguments.png, "with --map: picture file");
  addOption(command, "--count", arguments.count, "with --map: number of places",
            CLI::Range(1, 1000000), kShowDefault);
  addOption(command, "--seed", arguments.seed, "with --map: seed of the places", kShowDefault);
  command.footer(
      R"(The force grows until no pressures within the limits keep the tip within the tolerance in a
stable shape. It and the moment keep their directions; the scene's load acts, too. Each
force is a solution of the loaded inverse (tier loaded, order 5, or exact where the scene
has that); with more actuators than the tip needs, eleven starts are tried, and nothing
proves that none carries more. Needs arm.stiffness.K_eps_n.
json: scene, tier, order, tip_m, tolerance_m, status (reached, unreached), reason,
position_error_m and pressures_pa (without the force), directions [{direction, force_n,
limit, stiffness_n_per_m (along the force, there), pressures_pa}], weakest and strongest
(of these; null if unreached). limit: actuators that end it with their limit, as "muscle_1
upper"; or unstable (no stable shape balances more), unactuated (the tip leaves the place
before any limit is met), none (nothing below ten times K_eps).
With --map: direction, count, median_n, weakest and strongest place {tip_m, ..}, png; csv:
a row for each place. Exit code 1 if the tip is not reached without the force.)");
}

void addAttain(Commands& commands) {
  auto [command, arguments] = commands.add<AttainArguments>(
      "attain", "whether a shape can be held under a load, and what is missing", run);
  addScene(command, arguments.scene);
  addOption(command, "--twists", arguments.twists,
            "the shape [m, rad]: vx,vy,vz,wx,wy,wz of each section, or of each of its pieces, as "
            "piece_twist of forward",
            kRequired);
  addOption(command, "--force", arguments.forces,
            "a force [N], base frame: s,fx,fy,fz; s runs over [k, k + 1] along section k, and its "
            "end is the tip; repeatable",
            TypeName{"S,FX,FY,FZ"})
      ->allow_extra_args(false);
  addOption(command, "--moment", arguments.moments, "likewise a moment [N m]: s,mx,my,mz",
            TypeName{"S,MX,MY,MZ"})
      ->allow_extra_args(false);
  addOption(command, "--tolerance", arguments.tolerance_percent,
            "residual up to which the shape counts as attainable [% of largest_force_n]",
            TypeName{"PERCENT"}, within(kTolerancePercent), kShowDefault);
  command.footer(
      R"(The scene's load acts, too. A constant twist balances a force at one place of the section
alone; give the pieces of a shape under load to compare with such a shape. Needs
arm.stiffness.K_eps_n.
json: scene, attainable, missing {s, force_n, moment_nm} (where most is missing, frame of
the base curve there), limit (actuators at limits without which less would be missing),
residual_n (root mean square over s of the missing wrench, as the force along the arm that
deforms it with the same energy), largest_force_n (that a section can make), pressures_pa (closest),
reason. Exit code 1 if it is not attainable.)");
}

}  // namespace helix_arm::cli
