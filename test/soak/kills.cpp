// Kills every node with SIGKILL at random moments and checks what docs/safety.md promises of its
// end: by the record of the emulated device, where the arm is on a line, and by what the other
// nodes publish, where it is simulated. Each node is then started again and has to work as before.
// Prints a row per node; exits with 1 if a promise was broken.
#include <csignal>
#include <set>

#include <CLI/CLI.hpp>
#include <actionlib/client/simple_action_client.h>

#include "helix_arm/LoopStatus.h"
#include "helix_arm/RunCalibrationAction.h"
#include "ros_bridge/common/client_watch.hpp"
#include "support/hardware_rig.hpp"
#include "support/random.hpp"

namespace helix_arm::test {
namespace {

Eigen::Vector3d pressures(Random& random) {  // [Pa]
  return {random.uniform(2e4, 2e5), random.uniform(2e4, 2e5), random.uniform(2e4, 2e5)};
}

/// What a kill has broken. A kill that breaks nothing returns how long after it the promise came
/// true [s].
struct Broken {
  std::string what;
};
[[noreturn]] void broken(const std::string& what) { throw Broken{what}; }

/// Handles callbacks up to a moment [s].
void spin(double duration) {
  waitFor([] { return false; }, duration);
}

bool isIn(const Inbox<SafetyState>& safety, const std::string& state) {
  return !safety.all().empty() && safety.last().state == state;
}

/// The device is told to vent and runs empty.
double vents(HardwareRig& rig, double begin, double rule) {
  if (!rig.ventsBy(begin, rule + kSlack)) broken("the device got no vent order");
  const double after = regulator::steadyNow() - begin;
  const auto isEmpty = [&] { return rig.regulator.pressure().maxCoeff() < kEmpty; };
  if (!waitFor(isEmpty, kVentTime + kSlack)) broken("pressure stands in the device");
  return after;
}

/// It vents and the safety core names the cause.
double ventsBecauseOf(HardwareRig& rig, const std::string& cause, double begin, double rule) {
  const double after = vents(rig, begin, rule);
  if (!rig.comesTo("vented")) broken("state is " + rig.safety.last().state);
  if (rig.safety.last().cause != cause) broken("cause is " + rig.safety.last().cause);
  return after;
}

// One emulated device on a line, which outlives whatever drives it.
class OnALine {
 public:
  OnALine(Line line, const std::string& name) : device_(line), name_(name) {}

  double commandNode(Random& random) {
    HardwareRig rig(device_, name_);
    if (random.uniform(0, 1) < 0.3) {  // while it starts
      rig.command(pressures(random));
      spin(random.uniform(0, 1.5));
    } else {
      if (!rig.bringTo(pressures(random)))
        broken("not enabled after the kill before: " + rig.node.outputNow());
    }
    rig.command(pressures(random));
    spin(random.uniform(0, 0.5));
    const double begin = regulator::steadyNow();
    rig.node.signal(SIGKILL);
    return vents(rig, begin, 0);
  }

  double guard(Random& random) {
    if (!rig_) rig_ = std::make_unique<HardwareRig>(device_, name_);
    if (!rig_->bringTo(pressures(random)))
      broken("not enabled after the kill before: " + rig_->safety.last().reason);
    rig_->command(pressures(random));
    spin(random.uniform(0, 1));
    const std::vector<pid_t> guards = guardsOf(device_.scene());
    if (guards.size() != 1) broken(std::to_string(guards.size()) + " guards");
    const double begin = regulator::steadyNow();
    ::kill(guards.front(), SIGKILL);
    return ventsBecauseOf(*rig_, "guard_lost", begin, 1);
  }

  double series(Random& random) {
    if (!rig_) rig_ = std::make_unique<HardwareRig>(device_, name_);
    rig_->fallSilent();  // the series commands alone
    Process series({HELIX_ARM_SERIES, "__ns:=/" + name_, "_scene:=" + device_.scene(),
                    "_loop:=true", "_ramp_s:=0.2", "_hold_s:=0.5"});
    const bool moves = waitFor([&] {
      if (!isIn(rig_->safety, "enabled")) rig_->trigger(names::kEnable);
      return device_.pressure().maxCoeff() > 3e4;
    });
    if (!moves) broken("it does not move the arm: " + series.outputNow());
    spin(random.uniform(0, 2));
    const double begin = regulator::steadyNow();
    series.signal(SIGKILL);
    return ventsBecauseOf(*rig_, "stale_target", begin, kTargetTimeout);
  }

  double loopOfAGoal(Random& random) {
    HardwareLoop arm(device_, name_);
    if (!arm.enable()) broken("not enabled: " + arm.rig.node.outputNow());
    arm.follow(30);
    if (!arm.isUnderWay()) broken("it does not move the arm: " + arm.loop.outputNow());
    spin(random.uniform(0, 1));
    const double begin = regulator::steadyNow();
    arm.loop.signal(SIGKILL);
    return ventsBecauseOf(arm.rig, "stale_target", begin, kTargetTimeout);
  }

  // At any moment: before its goal is taken, on the way to the first point, along the path.
  double clientOfAGoal(Random& random) {
    HardwareLoop arm(device_, name_);
    if (!arm.enable()) broken("not enabled: " + arm.rig.node.outputNow());
    arm.follow(30);
    spin(random.uniform(0, 4));
    const double begin = regulator::steadyNow();
    arm.client->signal(SIGKILL);
    constexpr double kLease =
        ros_bridge::ClientWatch::kMisses * ros_bridge::ClientWatch::kPeriod + kTargetTimeout;
    spin(kLease + 0.5);  // a goal that was on its way may move the arm for that long
    const auto isEmpty = [&] {
      return device_.isVented() && device_.pressure().maxCoeff() < kEmpty;
    };
    if (!waitFor(isEmpty, kVentTime + kSlack)) broken("pressure stands in the device");
    return regulator::steadyNow() - begin;
  }

 private:
  EmulatedRegulator device_;
  const std::string name_;
  std::unique_ptr<HardwareRig> rig_;
};

// The simulated arm of the demo with the loop closed, all nodes started by hand.
class InTheDemo {
 public:
  using Runs = actionlib::SimpleActionClient<RunCalibrationAction>;

  InTheDemo()
      : node_("/demo"),
        measured_(node_, names::kPressureMeasured),
        tip_target_(node_.advertise<TipTarget>(names::kTipTarget, 10)),
        safety_(node_, names::kSafetyState),
        loop_(node_, names::kVisualServoStatus) {
    for (const auto& [name, command] : commands()) start(name);
  }

  /// @param killed    node.
  /// @param promised  what is to hold after its end.
  double node(const std::string& killed, Random& random, const std::function<bool()>& promised) {
    if (!isClosed()) broken("the loop is not closed after the kill before: " + words());
    const double moment = regulator::steadyNow() + random.uniform(0, 1);
    until([&] { return regulator::steadyNow() >= moment; });
    const double begin = regulator::steadyNow();
    processes_.at(killed)->signal(SIGKILL);
    const bool kept = until(promised);
    const double after = regulator::steadyNow() - begin;
    const std::string state = words();
    const std::size_t told = safety_.all().size();
    start(killed);
    // A node that is killed leaves its latched state.
    const bool tells =
        killed != "pressure_command" || waitFor([&] { return safety_.all().size() > told; });
    if (!kept) broken(state);
    if (!tells) broken("no state after the restart");
    return after;
  }

  /// Each node that moves or measures the arm, and what is to hold after its end.
  std::map<std::string, std::function<bool()>> promises() {
    return {{"vision", [this] { return isLoop(LoopStatus::COASTING) || isLoop(LoopStatus::OPEN); }},
            {"simulated_rig",
             [this] { return isIn(safety_, "fault") && safety_.last().cause == "stale_reading"; }},
            {"pressure_command", [this] { return highest() < 3e4; }},
            {"visual_servo",
             [this] { return isIn(safety_, "vented") && safety_.last().cause == "stale_target"; }}};
  }
  /// Of a node that only watches: the arm stays enabled and its loop closed.
  double watcher(const std::string& name, Random& random) {
    std::size_t first = 0;
    const auto goesOn = [&] {
      if (first == 0) first = loop_.all().size();
      return loop_.all().size() > first + 30;
    };
    const double after = node(name, random, goesOn);
    for (std::size_t k = first; k < loop_.all().size(); ++k) {
      if (loop_.all()[k]->state != LoopStatus::CLOSED) broken(loop_.all()[k]->message);
    }
    return after;
  }

  /// During a run there and back, or without the way back.
  double calibrationRun(Random& random) {
    Runs runs("/demo/calibration/run_calibration", false);
    if (!waitFor([&] { return runs.isServerConnected(); })) broken("no action server");
    if (!waitFor([this] { return !isIn(safety_, "enabled"); })) broken(words());
    RunCalibrationGoal goal;
    goal.loop = random.uniform(0, 1) < 0.5;
    goal.fit = {goal.loop ? "response" : "K_kappa"};
    goal.plan = {2e5, 0, 0, 0, 2e5, 0, 0, 0, 2e5};
    // A node that has just started refuses until it has heard from the others.
    const auto moves = [this] { return highest() > 5e4; };
    const auto begins = [&] {
      runs.sendGoal(goal);
      waitFor([&] { return moves() || runs.getState().isDone(); });
      return moves();
    };
    const bool began = waitFor(begins);
    if (!began) broken("no run: " + (runs.getResult() ? runs.getResult()->message : words()));
    spin(random.uniform(0, 6));
    const double begin = regulator::steadyNow();
    processes_.at("calibration")->signal(SIGKILL);
    const auto isDown = [this] { return !isIn(safety_, "enabled") && highest() < 3e4; };
    if (!waitFor(isDown)) broken(words());
    const double after = regulator::steadyNow() - begin;
    start("calibration");
    return after;
  }

 private:
  static std::map<std::string, std::vector<std::string>> commands() {
    const std::string folder = std::filesystem::temp_directory_path().string();
    return {{"pressure_command",
             {HELIX_ARM_PRESSURE_COMMAND, "_regulator:=topic", "_auto_enable:=true",
              "_handle:=false", "tip_target:=pressure_command/tip_target",
              "shape_target:=pressure_command/shape_target"}},
            {"simulated_rig", {HELIX_ARM_SIMULATED_RIG, "_camera_rate:=12"}},
            {"vision", {HELIX_ARM_VISION, "_source:=image/compressed"}},
            {"visual_servo", {HELIX_ARM_VISUAL_SERVO}},
            {"monitor", {HELIX_ARM_MONITOR}},
            {"workspace_cloud", {HELIX_ARM_WORKSPACE_CLOUD}},
            {"calibration",
             {HELIX_ARM_CALIBRATION, "_data_folder:=" + folder, "_out_folder:=" + folder,
              "_ramp_kpa_s:=200"}}};
  }
  void start(const std::string& name) {
    std::vector<std::string> command = commands().at(name);
    command.insert(command.begin() + 1, {"__ns:=/demo", "_scene:=demo"});
    processes_[name] = std::make_unique<Process>(command);
  }

  // Repeats a target until the condition holds.
  bool until(const std::function<bool()>& condition) {
    return waitFor(
        [&] {
          const ros::SteadyTime now = ros::SteadyTime::now();
          if (now - last_sent_ > ros::WallDuration(0.1)) {
            last_sent_ = now;
            TipTarget target;
            target.header.stamp = ros::Time::now();
            target.mode = TipTarget::POSITION;
            target.pose.position.x = 0.366;
            target.pose.position.y = 0.0035;
            target.pose.position.z = 0.0088;
            tip_target_.publish(target);
          }
          return condition();
        },
        60);
  }
  bool isClosed() {
    return until([this] { return isLoop(LoopStatus::CLOSED) && isIn(safety_, "enabled"); });
  }
  // By a message that came lately: a killed node leaves its last one.
  bool isLoop(const std::string& state) const {
    return !loop_.all().empty() && loop_.last().state == state &&
           ros::Time::now() - loop_.last().header.stamp < ros::Duration(0.5);
  }
  double highest() const {
    const auto& all = measured_.all();
    if (all.empty()) return 0;
    return *std::max_element(all.back()->pressure.begin(), all.back()->pressure.end());
  }
  std::string words() const {
    return (safety_.all().empty() ? "no state"
                                  : safety_.last().state + ": " + safety_.last().reason) +
           "; loop " +
           (loop_.all().empty() ? "silent" : loop_.last().state + ": " + loop_.last().message);
  }

  ros::NodeHandle node_;
  Inbox<PressureArray> measured_;
  ros::Publisher tip_target_;
  Inbox<SafetyState> safety_;
  Inbox<LoopStatus> loop_;
  ros::SteadyTime last_sent_;
  std::map<std::string, std::unique_ptr<Process>> processes_;
};

/// Kills at so many moments and prints the row. Returns how many promises were broken.
int row(const std::string& name, int moments, const std::function<double(Random&)>& killOnce) {
  Random random(1);
  std::vector<double> times;
  std::multiset<std::string> faults;
  for (int k = 0; k < moments && ros::ok(); ++k) {
    try {
      times.push_back(killOnce(random));
    } catch (const Broken& fault) {
      faults.insert(fault.what);
    }
  }
  std::sort(times.begin(), times.end());
  std::printf("%-44s %3zu kept, %zu broken; after %.2f s, at most %.2f s\n", name.c_str(),
              times.size(), faults.size(), times.empty() ? 0 : times[times.size() / 2],
              times.empty() ? 0 : times.back());
  for (const std::string& fault : faults) std::printf("  BROKEN: %s\n", fault.c_str());
  std::fflush(stdout);
  return static_cast<int>(faults.size());
}

int killsOnALine(Line line, const std::string& name, int moments) {
  OnALine arm(line, name);
  using Method = double (OnALine::*)(Random&);
  const std::pair<const char*, Method> rows[] = {
      {"pressure_command", &OnALine::commandNode},
      {"visual_servo with a goal", &OnALine::loopOfAGoal},
      {"client of a goal (follow_path)", &OnALine::clientOfAGoal},
      {"guard", &OnALine::guard},
      {"pressure_series", &OnALine::series}};
  int out = 0;
  for (const auto& [words, method] : rows) {
    out += row(name + ": " + words, moments,
               [&, method = method](Random& random) { return (arm.*method)(random); });
  }
  return out;
}

int killsInTheDemo(int moments) {
  std::unique_ptr<InTheDemo> demo;
  int out = 0;
  const auto add = [&](const char* words, const std::function<double(Random&)>& killOnce) {
    out += row(std::string("demo: ") + words, moments, [&](Random& random) {
      if (!demo) demo = std::make_unique<InTheDemo>();
      return killOnce(random);
    });
  };
  for (const char* name : {"vision", "simulated_rig", "pressure_command", "visual_servo"}) {
    add(name,
        [&, name](Random& random) { return demo->node(name, random, demo->promises().at(name)); });
  }
  for (const char* watcher : {"monitor", "workspace_cloud"}) {
    add(watcher, [&, watcher](Random& random) { return demo->watcher(watcher, random); });
  }
  add("calibration in a run", [&](Random& random) { return demo->calibrationRun(random); });
  return out;
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  using namespace helix_arm::test;
  int moments = 50;
  CLI::App app{"Kills every node at random moments and prints a row per node"};
  app.add_option("--moments", moments)->check(CLI::PositiveNumber);
  CLI11_PARSE(app, argc, argv);
  const Master master;
  for (const auto& [name, value] : master.variables()) setenv(name.c_str(), value.c_str(), 1);
  int none = 0;
  ros::init(none, nullptr, "kills", ros::init_options::AnonymousName);
  const ros::NodeHandle started;
  int broken = 0;
  for (const Line line : kLines) broken += killsOnALine(line, nameOf(line), moments);
  broken += killsInTheDemo(moments);
  std::printf("%d promises broken\n", broken);
  return broken > 0 ? 1 : 0;
}
