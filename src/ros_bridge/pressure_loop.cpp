#include "helix_arm/ros_bridge/pressure_loop.hpp"

#include <cstddef>
#include <utility>

#include <boost/make_shared.hpp>

#include "helix_arm/ros_bridge/conversions.hpp"
#include "helix_arm/ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

// More readings than these waiting: whoever takes them is slower than the loop, and gets the last.
constexpr std::size_t kMostWaiting = 4;

// What a callback queue holds.
class Call : public ros::CallbackInterface {
 public:
  explicit Call(std::function<void()> call) : call_(std::move(call)) {}
  CallResult call() override {
    call_();
    return Success;
  }

 private:
  std::function<void()> call_;
};

}  // namespace

PressureLoop::PressureLoop(ros::NodeHandle node, const model::Arm& arm,
                           const Eigen::VectorXd& start, double rate,
                           std::optional<regulator::SimulatedRegulator> regulator, Take take)
    : arm_(arm),
      take_(std::move(take)),
      command_(start),
      regulator_(std::move(regulator)),
      last_step_(ros::SteadyTime::now()),
      command_publisher_(node.advertise<PressureArray>(names::kPressureCommand, 10)),
      spinner_(1, &queue_) {
  if (regulator_) {
    regulator_->command(command_);
    measured_publisher_ = node.advertise<PressureArray>(names::kPressureMeasured, 10);
  }
  ros::SteadyTimerOptions turns(
      ros::WallDuration(1.0 / rate), [this](const ros::SteadyTimerEvent&) { turn(); }, &queue_);
  timer_ = node.createSteadyTimer(turns);
  spinner_.start();
}

PressureLoop::~PressureLoop() {
  timer_.stop();
  spinner_.stop();
  ros::getGlobalCallbackQueue()->removeByID(reinterpret_cast<std::uint64_t>(this));
}

void PressureLoop::command(const Eigen::VectorXd& pressure) {
  const std::lock_guard<std::mutex> lock(mutex_);
  command_ = pressure;
  if (regulator_) {
    // The old set points held until now: the lag up to this moment belongs to them.
    const ros::SteadyTime now = ros::SteadyTime::now();
    regulator_->step((now - last_step_).toSec());
    regulator_->command(command_);
    last_step_ = now;
  }
  publishCommand(ros::Time::now());
}

void PressureLoop::publishCommand(const ros::Time& stamp) {
  std_msgs::Header header;
  header.stamp = stamp;
  command_publisher_.publish(toPressureMsg(header, arm_, command_));
}

void PressureLoop::turn() {
  ++turns_;
  const std::lock_guard<std::mutex> lock(mutex_);
  const ros::Time stamp = ros::Time::now();
  publishCommand(stamp);
  if (!regulator_) return;
  const ros::SteadyTime now = ros::SteadyTime::now();
  regulator_->step((now - last_step_).toSec());
  last_step_ = now;
  Reading reading{regulator_->measure(), stamp};
  std_msgs::Header header;
  header.stamp = stamp;
  measured_publisher_.publish(toPressureMsg(header, arm_, reading.pressure));
  waiting_.push_back(std::move(reading));
  if (waiting_.size() > kMostWaiting) waiting_.erase(waiting_.begin());
  if (waiting_.size() > 1) return;
  ros::getGlobalCallbackQueue()->addCallback(boost::make_shared<Call>([this] { takeWaiting(); }),
                                             reinterpret_cast<std::uint64_t>(this));
}

void PressureLoop::takeWaiting() {
  std::vector<Reading> readings;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    readings.swap(waiting_);
  }
  if (readings.size() == kMostWaiting) readings.erase(readings.begin(), readings.end() - 1);
  for (const Reading& reading : readings) take_(reading);
}

}  // namespace helix_arm::ros_bridge
