// The panel while the arm dies, its services hang, and the ROS master is gone or hangs: the window
// goes on, and the words tell it. The arm is a stand-in in this process that counts what comes.
#include <QLineEdit>
#include <QSlider>
#include <QtTest/QTest>
#include <condition_variable>
#include <csignal>
#include <cstdlib>
#include <mutex>
#include <set>

#include <boost/function.hpp>
#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/callback_queue.h>
#include <ros/spinner.h>
#include <std_srvs/SetBool.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/SafetyState.h"
#include "helix_arm/TargetStatus.h"
#include "panel_window.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"
#include "support/process.hpp"

namespace helix_arm::test {
namespace {

namespace names = ros_bridge::names;

Master* master = nullptr;  // of this process
constexpr char kArm[] = "left";
constexpr double kPeriod = 0.05;     // of what a node publishes [s]
constexpr int kThreadsOfCalls = 32;  // more than the panel lets wait of all names together

// What has come to the nodes, and which calls hang: they have come, and do not happen yet.
class Record {
 public:
  int came(const std::string& what) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = came_.find(what);
    return found == came_.end() ? 0 : found->second;
  }
  void arrive(const std::string& what) {
    std::unique_lock<std::mutex> lock(mutex_);
    ++came_[what];
    changed_.wait(lock, [&] { return hanging_.count(what) == 0; });
  }
  void hang(const std::string& what) {
    const std::lock_guard<std::mutex> lock(mutex_);
    hanging_.insert(what);
  }
  void goOn() {
    const std::lock_guard<std::mutex> lock(mutex_);
    hanging_.clear();
    changed_.notify_all();
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, int> came_;
  std::set<std::string> hanging_;
};

// pressure_command: enables, vents, stops, and takes all pressures while enabled. Its topics and
// timer are in one thread of their own, its services in others, so that a call that hangs holds up
// nothing else.
class Arm {
 public:
  explicit Arm(Record& record)
      : record_(record),
        command_(node_.advertise<PressureArray>(names::kPressureCommand, 10)),
        reading_(node_.advertise<PressureArray>(names::kPressureMeasured, 10)),
        safety_(node_.advertise<SafetyState>(names::kSafetyState, 10, true)),
        status_(node_.advertise<TargetStatus>(names::kTargetStatus, 100)),
        model_(node_.advertise<ArmShape>(names::kModel, 10)),
        diagnostics_(node_.advertise<diagnostic_msgs::DiagnosticArray>(names::kDiagnostics, 10)),
        targets_(node_.subscribe(names::kPressureTarget, 10, &Arm::onTarget, this)) {
    triggers("enable", [this] { return enable(); });
    triggers("vent", [this] { return leave(SafetyState::VENTED); });
    triggers("rest", [this] { return leave(SafetyState::DISABLED); });
    serve<std_srvs::SetBool>("pressure_command/emergency_stop",
                             [this](auto& request, auto& answer) {
                               record_.arrive(request.data != 0 ? "stop" : "release");
                               const std::lock_guard<std::mutex> lock(mutex_);
                               stopped_ = request.data != 0;
                               if (stopped_) become(SafetyState::VENTED);
                               answer.success = 1;
                               tell();
                             });
    timer_ = node_.createSteadyTimer(ros::WallDuration(kPeriod),
                                     [this](const ros::SteadyTimerEvent&) { turn(); });
    spinner_.start();
    caller_.start();
  }
  ~Arm() {
    record_.goOn();
    timer_.stop();
    spinner_.stop();
    for (ros::ServiceServer& server : servers_) server.shutdown();
    caller_.stop();
  }

  std::string state() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return state_;
  }
  bool isStopped() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return stopped_;
  }
  double pressure() const {  // of the first muscle [Pa]
    const std::lock_guard<std::mutex> lock(mutex_);
    return pressure_.front();
  }

 private:
  static ros::NodeHandle on(ros::CallbackQueue& queue) {
    ros::NodeHandle node(kArm);
    node.setCallbackQueue(&queue);
    return node;
  }
  template <class Service, class Act>
  void serve(const std::string& name, const Act& act) {
    using Request = typename Service::Request;
    using Response = typename Service::Response;
    const boost::function<bool(Request&, Response&)> call = [act](Request& request,
                                                                  Response& response) {
      act(request, response);
      return true;
    };
    servers_.push_back(calls_node_.advertiseService(name, call));
  }
  // @return whether it is followed.
  bool answer() {
    TargetStatus status;
    status.topic = names::kPressureTarget;
    status.commander = ros::this_node::getName();  // the panel is in this process
    const bool taken = state() == SafetyState::ENABLED;
    status.outcome = taken ? TargetStatus::REACHED : TargetStatus::DROPPED;
    if (!taken) status.fault = "not_enabled";
    if (!taken) status.message = "the arm is not enabled";
    status_.publish(status);
    return taken;
  }
  // A call that comes, and happens unless it hangs.
  void triggers(const std::string& call, const std::function<std::string()>& act) {
    serve<std_srvs::Trigger>("pressure_command/" + call, [this, call, act](auto&, auto& answer) {
      record_.arrive(call);
      const std::lock_guard<std::mutex> lock(mutex_);
      answer.message = act();
      answer.success = answer.message.empty();
      tell();
    });
  }
  std::string enable() {
    if (stopped_) return "the emergency stop is engaged";
    if (state_ == SafetyState::ENABLED) return "it is already enabled";
    become(SafetyState::ENABLED);
    return {};
  }
  std::string leave(const std::string& state) {
    if (state_ == SafetyState::ENABLED) become(state);
    return {};
  }
  void become(const std::string& state) {
    state_ = state;
    std::fill(pressure_.begin(), pressure_.end(), 0.0);
  }

  void onTarget(const PressureArrayConstPtr& target) {
    record_.arrive("pressures");
    if (!answer()) return;
    const std::lock_guard<std::mutex> lock(mutex_);
    if (state_ == SafetyState::ENABLED) pressure_ = target->pressure;
  }
  void tell() {
    SafetyState safety;
    safety.state = state_;
    safety.cause = "none";
    safety.problem = "as told";
    safety.remedy = "call enable";
    safety.reason = state_ + ": as told; call enable";
    safety.stopped = stopped_;
    safety_.publish(safety);
  }
  void turn() {
    const std::lock_guard<std::mutex> lock(mutex_);
    PressureArray array;
    array.header.stamp = ros::Time::now();
    array.name = {"muscle_1", "muscle_2", "muscle_3"};
    array.pressure = pressure_;
    command_.publish(array);
    reading_.publish(array);
    ArmShape model;
    model.tip.position.x = 0.3;
    model_.publish(model);
    tell();
    const std::string node = node_.resolveName(names::kPressureCommandNode);
    diagnostic_msgs::DiagnosticArray diagnostics;
    for (const std::string& name : array.name) {
      auto& status = diagnostics.status.emplace_back();
      status.name = ros_bridge::statusName(node, names::kChannelStatus + name);
      ros_bridge::addValue(status, names::kLowerLimitKey, "0");
      ros_bridge::addValue(status, names::kUpperLimitKey, "400");
    }
    diagnostics_.publish(diagnostics);
  }

  mutable std::mutex mutex_;
  std::string state_ = SafetyState::DISABLED;
  bool stopped_ = false;
  std::vector<double> pressure_ = std::vector<double>(3, 0.0);
  Record& record_;
  ros::CallbackQueue queue_, calls_;
  ros::NodeHandle node_ = on(queue_), calls_node_ = on(calls_);
  ros::Publisher command_, reading_, safety_, status_, model_, diagnostics_;
  ros::Subscriber targets_;
  std::vector<ros::ServiceServer> servers_;
  ros::SteadyTimer timer_;
  ros::AsyncSpinner spinner_{1, &queue_}, caller_{kThreadsOfCalls, &calls_};
};

class CockpitStorm : public PanelWindow {
 protected:
  void SetUp() override {
    arm_ = std::make_unique<Arm>(record_);
    show(kArm);
    await([this] { return says("state", "DISABLED") && isOffered("enable"); });
  }
  void TearDown() override {
    record_.goOn();
    panel_.reset();
  }

  void click(const char* name) { QTest::mouseClick(find<QWidget>(name), Qt::LeftButton); }
  bool holds() { return find<QPushButton>("hold")->isChecked(); }

  void enable() {
    await([this] {
      if (isOffered("enable")) click("enable");
      return says("state", "ENABLED") && isOffered("slider_0");
    });
  }
  // Enables the arm again if a call that was made before is carried out late and vents it.
  void holdPressure() {
    auto* const slider = find<QSlider>("slider_0");
    int before = 0, wanted = 0;  // [100 Pa]
    await([&] {
      if (isOffered("enable")) {
        click("enable");
        wanted = 0;
      }
      if (!says("state", "ENABLED") || !isOffered("slider_0")) return false;
      if (wanted == 0) {
        before = record_.came("pressures");
        wanted = slider->value() == 1000 ? 900 : 1000;
        slider->setValue(wanted);
      }
      return record_.came("pressures") > before && arm_->pressure() == 100.0 * wanted;
    });
  }
  // Nothing held, not stopped.
  bool isClear() {
    if (holds()) click("hold");
    if (isOffered("release")) click("release");
    return !holds() && !arm_->isStopped() && !says("state", "STOPPED");
  }

  Record record_;
  std::unique_ptr<Arm> arm_;
};

// Whatever hangs, and whether it answers never or late.
TEST_F(CockpitStorm, NoHangingCallHoldsUpTheWindowAStopOrARest) {
  const auto stops = [this](const char* hanging) {
    const int before = record_.came("stop");
    EXPECT_LT(stillness([this] { click("stop"); },
                        [&] { return record_.came("stop") > before && arm_->isStopped(); }),
              kMostStill)
        << hanging;
    ASSERT_TRUE(arm_->isStopped());
    if (hanging == std::string("enable")) {
      EXPECT_LT(stillness([] {}, [&] { return says("answer", "Enable: no answer within 3 s"); }),
                kMostStill)
          << text("answer");
    }
    record_.goOn();
    await([this] { return isClear(); });
  };
  record_.hang("enable");
  click("enable");
  await([this] { return record_.came("enable") == 1; });
  stops("enable");

  holdPressure();
  record_.hang("vent");
  click("vent");
  await([this] { return record_.came("vent") > 0 && isOffered("hold"); });
  // The arm is enabled as before: what is held ends by a rest.
  holdPressure();
  const int rests = record_.came("rest");
  EXPECT_LT(stillness([this] { click("hold"); },
                      [&] { return record_.came("rest") > rests && says("state", "DISABLED"); }),
            kMostStill);
  stops("vent");

  holdPressure();
  record_.hang("rest");
  click("hold");
  await([&] { return record_.came("rest") > rests + 1; });
  stops("rest");
}

TEST_F(CockpitStorm, ALateReleaseOrEnableUndoesNoStopAndNoVent) {
  click("stop");
  await([this] { return arm_->isStopped() && isOffered("release"); });
  record_.hang("release");
  click("release");
  await([this] { return record_.came("release") == 1; });
  click("stop");
  await([this] { return record_.came("stop") == 2; });
  record_.goOn();  // the older release happens now
  await([this] { return record_.came("stop") == 3 && arm_->isStopped(); });
  awaitSaid("state", "STOPPED");
  await([this] { return isClear(); });

  record_.hang("enable");
  awaitOffer("enable");
  click("enable");
  await([this] { return record_.came("enable") == 1; });
  const int vents = record_.came("vent");
  click("vent");
  await([&] { return record_.came("vent") == vents + 1; });
  record_.goOn();
  await([&] { return record_.came("vent") == vents + 2 && arm_->state() == SafetyState::VENTED; });
  enable();  // asked for anew, it stays
}

TEST_F(CockpitStorm, AnArmThatDiesIsToldAndTheStopStaysOffered) {
  holdPressure();
  arm_.reset();
  awaitSaid("state", "NO CONNECTION");
  for (const char* name : {"enable", "vent", "release", "slider_0", "value_0", "tip_go"}) {
    EXPECT_FALSE(isOffered(name)) << name;
  }
  EXPECT_TRUE(isOffered("stop"));
  arm_ = std::make_unique<Arm>(record_);
  await([this] { return says("state", "DISABLED") && isOffered("enable") && !holds(); });
  enable();
  EXPECT_EQ(arm_->pressure(), 0);
}

// The last test: afterwards the master knows no node of this process.
class CockpitMaster : public PanelWindow {
 protected:
  void TearDown() override { panel_.reset(); }  // while there is a master

  void enter(const char* ns) {
    auto* const field = find<QLineEdit>("namespace");
    field->selectAll();
    QTest::keyClicks(field, ns);
    QTest::keyClick(field, Qt::Key_Return);
  }
};

TEST_F(CockpitMaster, NeitherItsEndNorItsSilenceStopsTheWindow) {
  const auto nothing = [] {};
  EXPECT_LT(stillness([this] { show("left"); }, [this] { return named() == "/left"; }), 5);

  master->stop();
  const auto told = [this] { return says("answer", "does not answer"); };
  EXPECT_LT(stillness([this] { enter("right"); }, told), kMostStill) << "gone";
  EXPECT_TRUE(says("answer", "stays with the arm of /left"));
  EXPECT_EQ(named(), "/left");
  EXPECT_FALSE(find<QLineEdit>("namespace")->styleSheet().isEmpty());
  EXPECT_LT(stillness([this] { find<QPushButton>("stop")->click(); },
                      [this] { return says("answer", "relief valve by hand"); }),
            kMostStill);

  // One that starts without a master has no arm, and says why.
  EXPECT_LT(stillness([this] { show("left"); },
                      [this] { return says("cause", "the ROS master at http://"); }),
            kMostStill);
  EXPECT_EQ(named(), "no arm");
  find<QPushButton>("stop")->click();
  EXPECT_TRUE(says("answer", "relief valve by hand"));

  master->start();
  EXPECT_LT(stillness(nothing, [this] { return named() == "/left"; }), kMostStill) << "back";

  master->signal(SIGSTOP);
  EXPECT_LT(stillness([this] { enter("right"); }, told), kMostStill) << "hangs";
  EXPECT_EQ(named(), "/left");
  master->signal(SIGCONT);
  EXPECT_LT(stillness(nothing, [this] { return named() == "/right"; }), kMostStill) << "awake";
}

}  // namespace
}  // namespace helix_arm::test

int main(int argc, char** argv) {
  helix_arm::test::Master master;
  helix_arm::test::master = &master;
  for (const auto& [name, value] : master.variables()) setenv(name.c_str(), value.c_str(), 1);
  QApplication application(argc, argv);
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "cockpit_storm_test", ros::init_options::NoSigintHandler);
  ros::start();  // the node outlives every link, as that of rviz does
  const int result = RUN_ALL_TESTS();
  // The link of the last window ends in a thread of its own.
  const auto ended = [] {
    ros::V_string topics;
    ros::this_node::getSubscribedTopics(topics);
    return topics.empty();
  };
  if (!QTest::qWaitFor(ended, 30'000)) return 1;
  ros::shutdown();
  return result;
}
