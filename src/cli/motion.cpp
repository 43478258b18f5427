#include <iostream>
#include <sstream>
#include <stdexcept>

#include "command.hpp"
#include "helix_arm/dynamics/arm_motion.hpp"
#include "io/document/atomic_file.hpp"
#include "measurements.hpp"
#include "procedures/report_plot.hpp"
#include "regulator/regulator_io.hpp"

namespace helix_arm::cli {
namespace {

constexpr model::Range kStep{1e-6, 0.1}, kEvery{1e-6, 1e6};
constexpr double kRounding = 1e-9;  // of a time, in intervals of the output

struct MotionArguments {
  std::string scene, pressures, out, png, start = "rest";
  std::optional<double> step;
  std::optional<int> order;
  double every = 0.005;
};

// The moved tip at its times.
struct Motion {
  std::vector<double> time;
  std::vector<lie::SE3> tip;
  dynamics::MotionSummary summary;
  double seconds;  // that it took
};

dynamics::InputSeries seriesOf(const io::Scene& scene, const io::DataSet& data) {
  dynamics::InputSeries series;
  series.input = inputRowsOf(scene, data);
  const Eigen::VectorXd time = columnsOf(data, {"time_s"});
  for (Eigen::Index row = 0; row < time.size(); ++row) {
    refuseIf(row > 0 && !(time[row] > time[row - 1]), data.path, ":",
             data.lines[static_cast<std::size_t>(row)], " time_s is ", time[row],
             "; expected more than ", time[row - 1], " of the row before");
    series.time.push_back(time[row]);
  }
  return series;
}

// Every so often from the first row to the last.
std::vector<double> timesOf(const dynamics::InputSeries& series, double every) {
  constexpr double kMost = 1e7;
  const double first = series.time.front();
  const double count = std::floor((series.time.back() - first) / every + kRounding);
  refuseIf(count > kMost, "--every-s ", every,
           " makes more than 10 million rows; give a longer time");
  std::vector<double> times;
  for (double i = 0; i <= count; ++i)
    times.push_back(std::min(first + i * every, series.time.back()));
  return times;
}

dynamics::ArmMotion armOf(const io::Scene& scene, const MotionArguments& arguments) {
  dynamics::MotionConfig config = scene.dynamics;
  config.order = arguments.order.value_or(config.order);
  config.step = arguments.step.value_or(config.step);
  return {scene.arm, scene.planar, scene.model.load(), config};
}

// Vibrations about the rest at inputs (n), slowest first; null without a rest.
json vibrationsAt(const dynamics::ArmMotion& arm, const Eigen::VectorXd& input) {
  try {
    return listJson(dynamics::vibrationsOf(arm.linearisedAt(input)),
                    [](const dynamics::Vibration& one) -> json {
                      return {{"frequency_hz", one.frequency}, {"damping", one.damping}};
                    });
  } catch (const std::runtime_error&) {  // an arm that falls for ever has no rest
    return nullptr;
  }
}

Motion move(const dynamics::ArmMotion& arm, const MotionArguments& arguments,
            const dynamics::InputSeries& series) {
  Motion motion;
  motion.time = timesOf(series, arguments.every);
  const InterruptWatch watch;
  const double begin = regulator::steadyNow();
  Progress progress("motion", motion.time.back(), " s");
  motion.summary = arm.follow(
      series, arguments.start == "rest" ? dynamics::Start::kRest : dynamics::Start::kStraight,
      motion.time, [&](std::size_t i, const lie::SE3& tip) {
        motion.tip.push_back(tip);
        return progress.reached(motion.time[i]);
      });
  motion.seconds = regulator::steadyNow() - begin;
  return motion;
}

std::string csvOf(const io::Scene& scene, const Motion& motion) {
  std::ostringstream out;
  out << "# Motion of the tip of scene " << scene.name
      << ", seen from the arm's base: position [m], unit quaternion.\n";
  CsvTable table(out, {"time_s", "position_m", "quaternion_xyzw"});
  for (std::size_t i = 0; i < motion.tip.size(); ++i) {
    json row = motion.tip[i];
    row["time_s"] = motion.time[i];
    table.add(row);
  }
  return out.str();
}

json reportOf(const io::Scene& scene, const MotionArguments& arguments, const Motion& motion,
              const json& vibrations) {
  const dynamics::Energy& energy = motion.summary.energy;
  const double moved = motion.time.back() - motion.time.front();
  return {{"scene", scene.name},
          {"order", arguments.order.value_or(scene.dynamics.order)},
          {"step_s", arguments.step.value_or(scene.dynamics.step)},
          {"start", arguments.start},
          {"rows", motion.tip.size()},
          {"duration_s", moved},
          {"real_time_factor", motion.seconds > 0 ? json(moved / motion.seconds) : json()},
          {"steps", motion.summary.steps},
          {"energy_j",
           {{"kinetic", energy.kinetic},
            {"elastic", energy.elastic},
            {"potential", energy.potential},
            {"dissipated", energy.dissipated},
            {"work", energy.work}}},
          {"tip", motion.tip.back()},
          {"vibrations", vibrations},
          {"out", textOrNull(arguments.out)},
          {"png", textOrNull(arguments.png)}};
}

void draw(const io::Scene& scene, const Motion& motion, const std::string& png) {
  json position = json::array();
  for (const lie::SE3& tip : motion.tip) position.push_back(tip.translation);
  const json report{{"scene", scene.name},
                    {"series",
                     {{"time_s", motion.time},
                      {"trial", std::vector<std::string>(motion.tip.size(), "motion")},
                      {"model_m", position}}}};
  procedures::drawReport(report.dump(), png, "leave out --png");
}

int run(const MotionArguments& arguments, const GlobalOptions& global) {
  const io::Scene scene = loadScene(arguments.scene, global);
  requireNoInput(arguments.out, {arguments.pressures});
  requireWritable({arguments.out, arguments.png});
  const dynamics::InputSeries series = seriesOf(scene, tableOf(arguments.pressures));
  const dynamics::ArmMotion arm = armOf(scene, arguments);
  const Motion motion = move(arm, arguments, series);
  if (interrupted()) return kInterrupted;
  if (!arguments.out.empty()) io::writeFileAtomically(arguments.out, csvOf(scene, motion));
  if (!arguments.png.empty()) draw(scene, motion, arguments.png);
  if (arguments.out.empty() && global.format != Format::kJson) {
    std::cout << csvOf(scene, motion);
    return kDone;
  }
  const Eigen::VectorXd last = series.input.row(series.input.rows() - 1);
  const json report = reportOf(scene, arguments, motion, vibrationsAt(arm, last));
  printResult(global.format, report, report,
              Csv{{"rows", "duration_s", "real_time_factor", "steps"}});
  return kDone;
}

}  // namespace

void addMotion(Commands& commands) {
  auto [command, arguments] = commands.add<MotionArguments>(
      "motion", "pressures over time to the motion of the tip, with the arm's inertia", run);
  addScene(command, arguments.scene);
  addOption(command, "PRESSURES", arguments.pressures,
            "table with the columns time_s and pressure_1_kpa .. (or pressure_1_pa .., or input_1 "
            ".. in SI units), linear between its rows; stdin where it is -",
            kRequired);
  addOption(command, "--out", arguments.out,
            "table to write: time_s, x_m, y_m, z_m, qx, qy, qz, qw; default: stdout",
            TypeName{"FILE"});
  addOption(command, "--every-s", arguments.every, "time between its rows [s]", TypeName{"S"},
            within(kEvery), kShowDefault);
  addOption(command, "--step-s", arguments.step,
            "longest step of the integration [s]; default: the scene's dynamics.step_s",
            TypeName{"S"}, within(kStep));
  addOption(command, "--order", arguments.order,
            "degree of the strain along each section, 0: constant; default: the scene's "
            "dynamics.order",
            CLI::Range(0, dynamics::kMostOrder));
  addOption(command, "--start", arguments.start,
            "rest: in equilibrium under load at the pressures of the first row; straight: at "
            "natural length",
            CLI::IsMember({"rest", "straight"}), kShowDefault);
  addOption(command, "--png", arguments.png, "picture of the tip's coordinates over time",
            TypeName{"FILE"});
  command.footer(
      R"(The equations: docs/motion.md. The scene needs load.mass_kg; its key dynamics has damping.
json: scene, order, step_s, start, rows, duration_s, real_time_factor (of the time moved
over that of the computation), steps, energy_j {kinetic, elastic, potential (since the
start), dissipated, work (of the actuators, with the elastic energy at the start)} at the
end, where kinetic + elastic + potential + dissipated = work, tip, vibrations
[{frequency_hz, damping}] (of small motions about the rest at the last pressures, slowest
first; null if there is none), out, png (null if absent). text, csv: the motion; with --out a summary. Progress is printed on stderr.)");
}

}  // namespace helix_arm::cli
