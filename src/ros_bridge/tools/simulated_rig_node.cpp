#include "simulated_rig_node.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include "helix_arm/control/target_check.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/names.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/pressure/regulator_setup.hpp"
#include "ros_bridge/vision/pictures.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr model::Range kTimeFactors = {0.01, 1000.0};
constexpr double kFirstReading = 3.0;  // time that the regulator's node has to start [s]

}  // namespace

SimulatedRigOptions SimulatedRigOptions::load() {
  ParameterReader reader{ros::NodeHandle("~")};
  SimulatedRigOptions out;
  out.scene = reader.file("scene", "config/scenes", ".yaml");
  out.regulator = reader.choice("regulator", out.regulator, {"scene", "topic"});
  out.rate = reader.number("rate", out.rate, {1.0, 1000.0});
  out.camera_rate = reader.number("camera_rate", out.camera_rate, {0.1, 100.0});
  out.frame_prefix = reader.frame("frame_prefix", "");
  out.command_timeout = reader.number("command_timeout_s", out.command_timeout, {0.01, 60.0});
  out.time_factor = reader.number("time_factor", out.time_factor, {0.0, kTimeFactors.upper});
  reader.finish();
  if (out.time_factor != 0 && !kTimeFactors.contains(out.time_factor)) {
    throw ParameterError("~time_factor is " + std::to_string(out.time_factor) +
                         "; expected 0, or a number from 0.01 to 1000");
  }
  if (out.time_factor != 0 && out.regulator != "scene") {
    throw ParameterError("~time_factor is " + std::to_string(out.time_factor) +
                         ", but ~regulator is " + out.regulator +
                         ": a regulator of another node has a time of its own; set it to 0");
  }
  if (out.time_factor != 0 && !ros::Time::isSimTime()) {
    throw ParameterError("~time_factor is " + std::to_string(out.time_factor) +
                         ", but the nodes use real time; set the parameter /use_sim_time to "
                         "true before any of them starts");
  }
  return out;
}

SimulatedRigNode::SimulatedRigNode()
    : options_(SimulatedRigOptions::load()),
      scene_(requirePneumatic(io::loadScene(options_.scene))),
      true_arm_(scene_.model, scene_.simulation.arm),
      response_(scene_.arm, scene_.simulation.arm.response),
      command_(Eigen::VectorXd::Zero(scene_.arm.actuatorCount())),
      last_step_(ros::SteadyTime::now()),
      last_input_(last_step_),
      silent_(options_.regulator == "scene") {
  if (options_.regulator == "scene") {
    regulator_ = makeSimulatedRegulator(scene_);
    response_.step(regulator_->pressure(), 0);  // vented
  }
  if (options_.time_factor > 0) {
    const ros::WallTime start = ros::WallTime::now();
    clock_ = {start.sec, start.nsec};
    clock_publisher_ = node_.advertise<rosgraph_msgs::Clock>(names::kClock, 10);
    publishClock();
  }
  truth_publisher_ = node_.advertise<ArmShape>(names::kTruth, 10);
  if (regulator_) {
    measured_publisher_ = node_.advertise<PressureArray>(names::kPressureMeasured, 10);
    pressure_subscriber_ =
        listen(node_, names::kPressureCommand, 10, &SimulatedRigNode::onCommand, this);
  } else {
    pressure_subscriber_ =
        listen(node_, names::kPressureMeasured, 10, &SimulatedRigNode::onReading, this);
  }
  force_subscriber_ =
      listen(private_node_, names::kTipForce, 10, &SimulatedRigNode::onTipForce, this);
  loop_timer_ = repeat(node_, "the rig", 1.0 / options_.rate, &SimulatedRigNode::onLoop, this);
  const bool seen = scene_.camera && scene_.tags;
  if (seen) {
    image_publisher_ = node_.advertise<sensor_msgs::Image>(names::kImage, 2);
    compressed_publisher_ =
        node_.advertise<sensor_msgs::CompressedImage>(names::kCompressedImage, 2);
    info_publisher_ = node_.advertise<sensor_msgs::CameraInfo>(names::kCameraInfo, 2);
    photographer_.start([this] { takePictures(); });
  }
  logInfo("%s: %s, %s", scene_.name.c_str(),
          regulator_ ? ("simulated regulator at " + fixed(options_.rate) + " Hz").c_str()
                     : "an arm at the pressures of pressure_measured",
          seen ? ("pictures at " + fixed(options_.camera_rate) + " Hz").c_str()
               : "no camera, since the scene lacks `camera` or `tags`");
}

SimulatedRigNode::~SimulatedRigNode() {
  {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
  }
  wake_.notifyAll();
  photographer_.join();
}

void SimulatedRigNode::onCommand(const PressureArrayConstPtr& command) {
  const auto checked =
      control::checkCommand(scene_.arm, command_, command->name, command->pressure);
  if (const auto* pressure = std::get_if<Eigen::VectorXd>(&checked)) {
    command_ = *pressure;
    regulator_->command(command_);
    noteInput();
  } else {
    drop(names::kPressureCommand, std::get<control::Refusal>(checked).message, bad_inputs_);
  }
}

void SimulatedRigNode::onReading(const PressureArrayConstPtr& reading) {
  const auto checked = control::checkReading(scene_.arm, reading->name, reading->pressure);
  if (const auto* pressure = std::get_if<Eigen::VectorXd>(&checked)) {
    response_.follow(reading->header.stamp.toSec(), *pressure);
    noteInput();
    publishTruth(reading->header);
  } else {
    drop(names::kPressureMeasured, std::get<control::Refusal>(checked).message, bad_inputs_);
  }
}

void SimulatedRigNode::onTipForce(const geometry_msgs::WrenchStampedConstPtr& wrench) {
  const auto checked = fromMsg(*wrench, options_.frame_prefix + names::kBaseFrame);
  std::string fault;
  if (const auto* force = std::get_if<Eigen::Vector3d>(&checked)) {
    try {
      true_arm_.setTipForce(*force);
      return;
    } catch (const std::invalid_argument& error) {
      fault = error.what();
    }
  } else {
    fault = std::get<control::Refusal>(checked).message;
  }
  drop(std::string("~") + names::kTipForce, fault, bad_forces_);
}

void SimulatedRigNode::drop(const std::string& topic, const std::string& fault, FaultCount& count) {
  if (!count.add()) return;
  logWarning("%s: %s (dropped, %lu so far)", topic.c_str(), fault.c_str(),
             static_cast<unsigned long>(count.total()));
}

void SimulatedRigNode::noteInput() {
  last_input_ = ros::SteadyTime::now();
  silent_ = false;
  heard_ = true;
}

void SimulatedRigNode::noteSilence(const ros::SteadyTime& now) {
  const double longest =
      heard_ ? options_.command_timeout : std::max(options_.command_timeout, kFirstReading);
  if (silent_ || now - last_input_ <= ros::WallDuration(longest)) return;
  silent_ = true;
  if (!heard_) {
    logWarning(
        "no %s has come for %g s: neither truth nor picture until one does; is the node of "
        "the regulator running, and in this namespace?",
        names::kPressureMeasured, longest);
    return;
  }
  if (regulator_) regulator_->command(Eigen::VectorXd::Zero(command_.size()));
  logWarning("no %s for %g s (~command_timeout_s): %s; is pressure_command running?",
             regulator_ ? names::kPressureCommand : names::kPressureMeasured,
             options_.command_timeout,
             regulator_ ? "the regulator vents by itself" : "no picture until the next one");
}

void SimulatedRigNode::onLoop(const ros::SteadyTimerEvent&) {
  const ros::SteadyTime now = ros::SteadyTime::now();
  double dt = (now - last_step_).toSec();
  last_step_ = now;
  if (options_.time_factor > 0) {
    dt *= options_.time_factor;
    clock_ += ros::Duration(dt);
    publishClock();
  }
  noteSilence(now);
  if (!regulator_) return;
  regulator_->step(dt);
  response_.step(regulator_->pressure(), dt);
  std_msgs::Header header;
  header.stamp = options_.time_factor > 0 ? clock_ : ros::Time::now();
  measured_publisher_.publish(toPressureMsg(header, scene_.arm, regulator_->measure()));
  publishTruth(header);
}

void SimulatedRigNode::publishTruth(std_msgs::Header header) {
  std::optional<Moment> moment;
  try {
    moment = Moment{header.stamp, true_arm_.shape(response_.effective())};
  } catch (const std::runtime_error& fault) {
    if (no_truths_.add()) {
      logWarning("%s (%lu times so far): neither truth nor picture until another command or force",
                 fault.what(), static_cast<unsigned long>(no_truths_.total()));
    }
  }
  if (moment) {
    header.frame_id = options_.frame_prefix + names::kBaseFrame;
    truth_publisher_.publish(toShapeMsg(header, "truth", moment->shape));
  }
  const basics::MutexLock lock(mutex_);
  now_ = moment;
}

void SimulatedRigNode::publishClock() {
  rosgraph_msgs::Clock message;
  message.clock = clock_;
  clock_publisher_.publish(message);
}

void SimulatedRigNode::takePictures() {
  using Clock = std::chrono::steady_clock;
  const simulation::CameraSetup setup = scene_.cameraSetup().value();
  simulation::SimulatedCamera camera(setup.view, setup.family, setup.body, setup.config);
  vision::JpegEncoder encoder(scene_.simulation.camera.jpeg_quality);
  const auto period = std::chrono::duration_cast<Clock::duration>(
      std::chrono::duration<double>(1.0 / options_.camera_rate));
  Clock::time_point due = Clock::now();
  const auto stopped = [this] {
    const basics::MutexLock lock(mutex_);
    return stop_;
  };
  while (!stopped()) {
    publishPicture(camera, encoder);
    due = std::max(due + period, Clock::now());
    basics::MutexLock lock(mutex_);
    wake_.waitUntil(lock, due, [this]() HELIX_ARM_REQUIRES(mutex_) { return stop_; });
  }
}

void SimulatedRigNode::publishPicture(simulation::SimulatedCamera& camera,
                                      vision::JpegEncoder& encoder) {
  const bool raw = image_publisher_.getNumSubscribers() > 0;
  const bool compressed = compressed_publisher_.getNumSubscribers() > 0;
  if (!raw && !compressed) return;
  std::optional<Moment> moment;
  {
    const basics::MutexLock lock(mutex_);
    std::swap(moment, now_);
  }
  if (!moment) return;
  std_msgs::Header header;
  header.stamp = moment->stamp;
  header.frame_id = options_.frame_prefix + names::kCameraFrame;
  const cv::Mat& picture = camera.render(moment->shape);
  info_publisher_.publish(toCameraInfoMsg(header, scene_.camera->model));
  if (compressed) {
    const auto message = boost::make_shared<sensor_msgs::CompressedImage>();
    message->header = header;
    message->format = "mono8; jpeg compressed mono8";
    message->data = encoder.encode(picture);
    compressed_publisher_.publish(message);
  }
  if (raw) {
    image_publisher_.publish(
        boost::make_shared<const sensor_msgs::Image>(toImageMsg(header, picture)));
  }
}

}  // namespace helix_arm::ros_bridge
