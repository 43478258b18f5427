#include <chrono>
#include <future>

#include <geometry_msgs/PoseStamped.h>
#include <rosgraph_msgs/Clock.h>

#include "basics/mutex.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/regulator/simulated_regulator.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"
#include "ros_bridge/vision/pictures.hpp"
#include "simulation/bodies.hpp"
#include "simulation/rig.hpp"
#include "vision/jpeg.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr model::Range kTimeFactors = {0.01, 1000.0};
constexpr double kFirstReading = 3.0;  // time that the regulator's node has to start [s]

/// Private parameters of simulated_rig.
struct SimulatedRigOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  /// "scene" simulates the scene's; "topic": the arm follows the readings of another regulator, on
  /// pressure_measured.
  std::string regulator = reader.choice("regulator", "scene", {"scene", "topic"});
  double rate = reader.number("rate", 100.0, {1.0, 1000.0});              ///< of the regulator [Hz]
  double camera_rate = reader.number("camera_rate", 15.0, {0.1, 100.0});  ///< of the pictures [Hz]
  std::string frame_prefix = reader.frame("frame_prefix", "");
  /// Time without commands after which the regulator vents by itself, or without readings after
  /// which their absence is warned of (before the first one, at least 3 s) [s].
  double command_timeout = reader.number("command_timeout_s", 0.5, {0.01, 60.0});
  /// 0 uses the time of the other nodes. Else, 0.01 to 1000, this node is their clock (needs
  /// use_sim_time), with so many simulated seconds per second; not with another node's regulator.
  double time_factor = reader.number("time_factor", 0.0, {0.0, kTimeFactors.upper});

  SimulatedRigOptions() {
    reader.finish();
    if (time_factor == 0) return;
    const auto require = [this](bool holds, const std::string& rule) {
      basics::require(holds, "~time_factor is ", std::to_string(time_factor), rule);
    };
    require(kTimeFactors.contains(time_factor), "; expected 0, or a number from 0.01 to 1000");
    require(regulator == "scene",
            ", but ~regulator is " + regulator +
                ": a regulator of another node has a time of its own; set it to 0");
    require(ros::Time::isSimTime(),
            ", but the nodes use real time; set the parameter /use_sim_time to true before any of "
            "them starts");
  }
};

/// Simulates the hardware of a scene: regulator, true arm and, if the scene has camera and tags,
/// the camera; if it has bodies, their motion-capture system. With ~regulator topic, it simulates
/// arm and camera alone: the arm has the pressures that a regulator measures, such as that of a
/// board without an arm. docs/nodes.md lists its topics and parameters (SimulatedRigOptions).
///
/// With every pressure_measured, the truth has its stamp and is under the scene's load and the
/// force at its tip; a picture has the stamp of the truth that it shows, its camera_info comes just
/// before it. ~rate and ~camera_rate are on a steady clock, independent of ~time_factor.
///
/// A bad command, reading or force is dropped, counted and warned of at intervals, as is a shape
/// that does not balance; the set points or the force stay.
class SimulatedRigNode : public Node {
 public:
  SimulatedRigNode()
      : scene_(requirePneumatic(io::loadScene(options_.scene))),
        true_arm_(scene_.model, scene_.simulation.arm),
        command_(Eigen::VectorXd::Zero(scene_.arm.actuatorCount())),
        last_step_(ros::SteadyTime::now()),
        last_input_(last_step_),
        silent_(options_.regulator == "scene") {
    if (options_.regulator == "scene") {
      const regulator::Config& config = requireRegulator(scene_);
      const auto* const simulated = std::get_if<regulator::SimulatedRegulatorConfig>(&config);
      basics::require(simulated != nullptr, "scene ", scene_.name, " has another regulator, ",
                      regulator::describe(config), "; expected regulator.simulated");
      warnOfShortSupply(scene_);
      regulator_.emplace(scene_.arm.actuatorCount(), *simulated);
    }
    if (options_.time_factor > 0) {
      const ros::WallTime start = ros::WallTime::now();
      clock_ = {start.sec, start.nsec};
      clock_publisher_ = node_.advertise<rosgraph_msgs::Clock>(names::kClock, 10);
      publishClock();
    }
    using Self = SimulatedRigNode;
    truth_publisher_ = node_.advertise<ArmShape>(names::kTruth, 10);
    if (regulator_) {
      measured_publisher_ = node_.advertise<PressureArray>(names::kPressureMeasured, 10);
      pressure_subscriber_ = listen(node_, names::kPressureCommand, 10, &Self::onCommand, this);
    } else {
      pressure_subscriber_ = listen(node_, names::kPressureMeasured, 10, &Self::onReading, this);
    }
    force_subscriber_ = listen(private_node_, names::kTipForce, 10, &Self::onTipForce, this);
    loop_timer_ = repeat(node_, "the rig", 1.0 / options_.rate, [this] { turn(); });
    const bool seen = scene_.isSeen() && !scene_.hasBodies();
    if (scene_.hasBodies()) {
      const simulation::CameraSetup setup = scene_.cameraSetup().value();
      bodies_.emplace(setup.view, setup.bodies);
      for (const estimation::TagPlacement& body : scene_.tags->tags) {
        pose_publishers_.push_back(
            node_.advertise<geometry_msgs::PoseStamped>("mocap/" + body.name + "/pose", 10));
      }
    }
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
            : bodies_
                ? ("poses of bodies at " + fixed(scene_.simulation.bodies.rate) + " Hz").c_str()
                : "no camera, since the scene lacks `camera` or `tags`");
  }

  ~SimulatedRigNode() override {
    stop_.set_value();
    photographer_.join();
  }

  int finish() override { return photographer_.verdict(); }

 private:
  /// The arm at one time.
  struct Moment {
    ros::Time stamp;
    model::Shape shape;
  };

  void onCommand(const PressureArrayConstPtr& command) {
    const auto checked =
        control::checkCommand(scene_.arm, command_, command->name, command->pressure);
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      return drop(names::kPressureCommand, refusal->message, bad_inputs_);
    }
    command_ = std::get<Eigen::VectorXd>(checked);
    regulator_->command(command_);
    noteInput();
  }

  void onTipForce(const geometry_msgs::WrenchStampedConstPtr& wrench) {
    const auto checked = fromMsg(*wrench, options_.frame_prefix + names::kBaseFrame);
    const std::string topic = std::string("~") + names::kTipForce;
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      return drop(topic, refusal->message, bad_forces_);
    }
    try {
      true_arm_.setTipForce(std::get<Eigen::Vector3d>(checked));
    } catch (const std::invalid_argument& error) {
      drop(topic, error.what(), bad_forces_);
    }
  }

  void onReading(const PressureArrayConstPtr& reading) {
    const auto checked = control::checkReading(scene_.arm, reading->name, reading->pressure);
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      return drop(names::kPressureMeasured, refusal->message, bad_inputs_);
    }
    noteInput();
    publishTruth(reading->header, [&] {
      true_arm_.follow(reading->header.stamp.toSec(), std::get<Eigen::VectorXd>(checked));
    });
  }

  void turn() {
    const ros::SteadyTime now = ros::SteadyTime::now();
    double dt = (now - last_step_).toSec();
    last_step_ = now;
    if (options_.time_factor > 0) {
      dt = options_.time_factor * std::min(dt, 2 / options_.rate);  // slower, but without a jump
      clock_ += ros::Duration(dt);
      publishClock();
    }
    noteSilence(now);
    if (!regulator_) return;
    regulator_->step(dt);
    std_msgs::Header header = toHeaderMsg(options_.time_factor > 0 ? clock_ : ros::Time::now());
    measured_publisher_.publish(toPressureMsg(header, scene_.arm, regulator_->measure()));
    publishTruth(header, [this, dt] { true_arm_.step(regulator_->pressure(), dt); });
  }

  /// Where they are due.
  void publishPoses(const Moment& moment) {
    constexpr double kSlack = 0.9;  // moments are not exactly periodic
    const double period = secondsBetween(last_poses_, moment.stamp);
    if (period >= 0 && period < kSlack / scene_.simulation.bodies.rate) return;
    last_poses_ = moment.stamp;
    for (const estimation::BodyPose& one : bodies_->see(moment.shape)) {
      geometry_msgs::PoseStamped pose;
      pose.header = toHeaderMsg(moment.stamp, options_.frame_prefix + names::kPoseFrame);
      pose.pose = toPoseMsg(one.X_CM);
      pose_publishers_[static_cast<std::size_t>(one.body)].publish(pose);
    }
  }

  static void drop(const std::string& topic, const std::string& fault, FaultCount& count) {
    if (!count.add()) return;
    logWarning("%s: %s (dropped, %lu so far)", topic.c_str(), fault.c_str(), count.total());
  }

  void noteInput() {
    last_input_ = ros::SteadyTime::now();
    silent_ = false;
    heard_ = true;
  }

  void noteSilence(const ros::SteadyTime& now) {
    const double longest =
        heard_ ? options_.command_timeout : std::max(options_.command_timeout, kFirstReading);
    if (silent_ || now - last_input_ <= ros::WallDuration(longest)) return;
    silent_ = true;
    if (!heard_) {
      return logWarning(
          "no %s has come for %g s: neither truth nor picture until one does; is the node of "
          "the regulator running, and in this namespace?",
          names::kPressureMeasured, longest);
    }
    if (regulator_) regulator_->command(Eigen::VectorXd::Zero(command_.size()));
    logWarning("no %s for %g s (~command_timeout_s): %s; is pressure_command running?",
               regulator_ ? names::kPressureCommand : names::kPressureMeasured,
               options_.command_timeout,
               regulator_ ? "the regulator vents by itself" : "no picture until the next one");
  }

  /// The arm after a step.
  template <class Step>
  void publishTruth(std_msgs::Header header, const Step& step) {
    std::optional<Moment> moment;
    try {
      step();
      moment = Moment{header.stamp, true_arm_.shape()};
    } catch (const std::runtime_error& fault) {
      if (no_truths_.add()) {
        logWarning(
            "%s (%lu times so far): neither truth nor picture until another command or force",
            fault.what(), no_truths_.total());
      }
    }
    if (moment) {
      header.frame_id = options_.frame_prefix + names::kBaseFrame;
      truth_publisher_.publish(toShapeMsg(header, "truth", moment->shape));
    }
    if (moment && bodies_) publishPoses(*moment);
    const basics::MutexLock lock(mutex_);
    now_ = moment;
  }

  void publishClock() {
    rosgraph_msgs::Clock message;
    message.clock = clock_;
    clock_publisher_.publish(message);
  }

  void takePictures() {
    using Clock = std::chrono::steady_clock;
    const simulation::CameraSetup setup = scene_.cameraSetup().value();
    simulation::SimulatedCamera camera(setup.view, setup.family, setup.body, setup.config);
    vision::JpegEncoder encoder(scene_.simulation.camera.jpeg_quality);
    const auto period = std::chrono::duration_cast<Clock::duration>(
        std::chrono::duration<double>(1.0 / options_.camera_rate));
    Clock::time_point due = Clock::now();
    const std::future<void> stop = stop_.get_future();
    while (stop.wait_until(due) == std::future_status::timeout) {
      publishPicture(camera, encoder);
      due = std::max(due + period, Clock::now());
    }
  }

  void publishPicture(simulation::SimulatedCamera& camera, vision::JpegEncoder& encoder) {
    const bool raw = image_publisher_.getNumSubscribers() > 0;
    const bool compressed = compressed_publisher_.getNumSubscribers() > 0;
    if (!raw && !compressed) return;
    std::optional<Moment> moment;
    {
      const basics::MutexLock lock(mutex_);
      std::swap(moment, now_);
    }
    if (!moment) return;
    const std_msgs::Header header =
        toHeaderMsg(moment->stamp, options_.frame_prefix + names::kCameraFrame);
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

  const SimulatedRigOptions options_{};
  const io::Scene scene_;
  std::optional<regulator::SimulatedRegulator> regulator_;  ///< with ~regulator scene
  simulation::MovingArm true_arm_;
  Eigen::VectorXd command_;     ///< in force, inside the limits [Pa]
  ros::SteadyTime last_step_;   ///< of the regulator
  ros::SteadyTime last_input_;  ///< last command, or last reading
  bool silent_;                 ///< none arrives; the regulator is vented
  bool heard_ = false;          ///< one has arrived
  ros::Time clock_;             ///< if ~time_factor is set
  FaultCount bad_inputs_, bad_forces_, no_truths_;

  ros::NodeHandle node_, private_node_{"~"};
  ros::Publisher measured_publisher_, truth_publisher_, clock_publisher_;
  ros::Publisher image_publisher_, compressed_publisher_, info_publisher_;
  ros::Subscriber pressure_subscriber_, force_subscriber_;
  ros::SteadyTimer loop_timer_;
  std::optional<simulation::SimulatedBodies> bodies_;
  ros::Time last_poses_;
  std::vector<ros::Publisher> pose_publishers_;  ///< of each body

  basics::Mutex mutex_;
  std::optional<Moment> now_ HELIX_ARM_GUARDED_BY(mutex_);  ///< the last one
  std::promise<void> stop_;                                 ///< of the pictures
  /// Renders, since a picture takes longer than a loop of the regulator.
  GuardedThread photographer_;
};

}  // namespace

std::unique_ptr<Node> makeSimulatedRig() { return std::make_unique<SimulatedRigNode>(); }

}  // namespace helix_arm::ros_bridge
