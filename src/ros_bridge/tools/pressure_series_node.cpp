#include <sstream>

#include <ros/this_node.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/procedures/pressure_plan.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/rest_request.hpp"
#include "ros_bridge/common/run_node.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

// Refusals, and commands of another arm, end the series only after this number of consecutive
// messages over this time.
constexpr int kLeastTrouble = 10;
constexpr double kLongestTrouble = 2;  // [s]
constexpr double kLongestStep = 0.1;   // after a pause of the node, the series does not jump [s]

/// Private parameters of pressure_series.
struct PressureSeriesOptions {
  ParameterReader reader{ros::NodeHandle("~")};
  std::string scene = reader.file("scene", "config/scenes", ".yaml");  ///< as pressure_command's
  /// CSV file, or name of a shipped series; none: a tour.
  std::string data = reader.optionalFile("data", "config/series", ".csv");
  procedures::SeriesTiming timing;
  double rate = 50.0;         ///< of the targets [Hz]
  bool yields = false;        ///< pause while another commander wants the arm
  double resume_after = 3.0;  ///< silence of the others that ends the pause [s]

  PressureSeriesOptions() {
    timing.ramp = reader.number("ramp_s", timing.ramp, {0.0, 3600.0});
    timing.hold = reader.number("hold_s", timing.hold, {0.0, 3600.0});
    timing.loop = reader.flag("loop", timing.loop);
    rate = reader.number("rate", rate, {1.0, 1000.0});
    yields = reader.flag("yields", yields);
    resume_after = reader.number("resume_after_s", resume_after, {0.1, 3600.0});
    reader.finish();
  }
};

// The rows to play; each of them must be a valid target.
Eigen::MatrixXd loadRows(const PressureSeriesOptions& options, const model::Arm& arm) {
  if (options.data.empty()) return procedures::pressureTour(arm);
  const io::DataSet data = io::loadDataSet(options.data);
  Eigen::MatrixXd rows = io::pressuresOf(data, arm.actuatorCount());
  std::string without;
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    const std::string column = "pressure_" + std::to_string(i + 1) + "_kpa";
    if (data.find(column) < 0) without += (without.empty() ? "" : ", ") + arm.actuator(i).name;
  }
  if (!without.empty()) {
    logWarning("%s has no column for %s: they stay at 0; is it for another arm?",
               options.data.c_str(), without.c_str());
  }
  const Eigen::VectorXd rest = Eigen::VectorXd::Zero(arm.actuatorCount());
  std::ostringstream faults;
  for (int row = 0; row < rows.rows(); ++row) {
    const Eigen::VectorXd wanted = rows.row(row);
    const std::vector<double> pressure(wanted.begin(), wanted.end());
    const auto checked = control::checkPressures(arm, rest, {}, pressure);
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      faults << options.data << " row " << row + 1 << ": " << refusal->message << "\n";
    }
  }
  if (!faults.str().empty()) throw std::invalid_argument(faults.str());
  return rows;
}

// Refusals that do not depend on the values of the target: the arm is not enabled, or was brought
// to rest by somebody else; messages are late, or clocks differ.
bool passes(const std::string& fault) {
  return fault == control::nameOf(control::Fault::kNotEnabled) ||
         fault == control::nameOf(control::Fault::kRested) ||
         fault == control::nameOf(control::Fault::kStale);
}

/// Plays a table of pressures to pressure_command: the columns pressure_<i>_kpa of a data set, row
/// by row.
///
/// Subscribes
/// - pressure_command (PressureArray): start of the first ramp; nothing is sent before it arrives
/// - target_status (TargetStatus): shows that another commander has the arm, or wants it
///
/// Publishes
/// - pressure_target (PressureArray): all actuators, gauge [Pa]; those without a column stay at 0,
///   with a warning at the start
///
/// Calls pressure_command/rest after the last row and when asked to end, if the arm follows it: the
/// arm ramps down and rests. Without that service it ends all the same.
///
/// Parameters: PressureSeriesOptions.
///
/// While the arm is not enabled, or targets arrive late (or clocks differ), it sends the arm's own
/// pressures as target, and continues from there once these are accepted.
///
/// Ends with 0 after the last row or when asked to, 1 if the ROS master is lost, or if for two
/// seconds all commands are of another arm, or all targets are refused for their values; 2 on a bad
/// parameter, scene or data set, or if a row is outside the limits of the scene. No single message
/// ends it.
class PressureSeriesNode : public Node {
 public:
  PressureSeriesNode() {
    using Self = PressureSeriesNode;
    target_publisher_ = node_.advertise<PressureArray>(names::kPressureTarget, 10);
    command_subscriber_ = listen(node_, names::kPressureCommand, 10, &Self::onCommand, this);
    status_subscriber_ = listen(node_, names::kTargetStatus, 100, &Self::onStatus, this);
    timer_ = repeat(node_, "the series", 1.0 / options_.rate, &Self::onTick, this);
  }

  int finish() override { return verdict_; }

  /// Not while the arm follows the series, or is about to: it is to be brought to rest first.
  bool mayEnd() const override {
    return !trace_.commands() && !trace_.awaitsAnswer() && !(mayBeUnheard() && end_began_.isZero());
  }

 private:
  /// Consecutive messages that indicate that the series is not for this arm.
  struct Trouble {
    int messages = 0;
    ros::SteadyTime since;
    FaultCount warnings;
    /// Counts one more; true once they are more than one or two stray messages.
    bool goesOn() {
      const ros::SteadyTime now = ros::SteadyTime::now();
      if (messages++ == 0) since = now;
      return messages >= kLeastTrouble && now - since >= ros::WallDuration(kLongestTrouble);
    }
  };

  void onCommand(const PressureArrayConstPtr& command) {
    const auto checked = control::checkReading(scene_.arm, command->name, command->pressure);
    if (const auto* refusal = std::get_if<control::Refusal>(&checked)) {
      suffer(foreign_,
             "pressure_command does not match scene " + scene_.name + ": " + refusal->message);
      return;
    }
    foreign_.messages = 0;
    command_ = scene_.arm.clamped(std::get<Eigen::VectorXd>(checked));  // vented: the atmosphere
    if (!player_) player_.emplace(rows_, command_, options_.timing);
  }

  void onStatus(const TargetStatusConstPtr& status) {
    trace_.answered(*status);
    const bool mine = status->commander == ros::this_node::getName();
    const std::string message = basics::quoted(status->message, kLongestMessage);
    if (mine && passes(status->fault)) {
      refused_.messages = 0;
      if (waits_.add()) logWarning("the series waits: %s", message.c_str());
      held_back_ = true;
      return;
    }
    if (mine && held_back_ && status->outcome != TargetStatus::DROPPED) {
      logInfo("targets are accepted again: the series continues");
      held_back_ = false;
      if (player_) player_->resume(command_);
    }
    const bool refused_to_command =
        status->fault == control::nameOf(control::Fault::kOtherCommander);
    const bool others_command =
        mine ? refused_to_command : refused_to_command || status->outcome != TargetStatus::DROPPED;
    const bool waits = options_.yields && others_command;
    if (mine && status->outcome == TargetStatus::DROPPED && !waits) {
      suffer(refused_, "the series was refused: " + message);
    } else if (mine) {
      refused_.messages = 0;
    }
    if (!waits) return;
    if (!yielding_) logInfo("another commander sends targets: the series waits");
    yielding_ = true;
    last_of_others_ = ros::SteadyTime::now();
  }

  void onTick(const ros::SteadyTimerEvent&) {
    const ros::SteadyTime now = ros::SteadyTime::now();
    const double dt =
        last_tick_.isZero() ? 0.0 : std::min((now - last_tick_).toSec(), kLongestStep);
    last_tick_ = now;
    if (over_ || EndRequest::made()) return endSeries();
    if (!player_ || target_publisher_.getNumSubscribers() == 0) return;
    if (yielding_) {
      if ((now - last_of_others_).toSec() < options_.resume_after) return;
      logInfo("the series continues");
      yielding_ = false;
      player_->resume(command_);
    } else if (!held_back_) {
      player_->advance(dt);
    }
    if (player_->row() != told_row_) {
      told_row_ = player_->row();
      static const Eigen::IOFormat kPlain(4, Eigen::DontAlignCols, " ");
      std::ostringstream text;
      text << (1e-3 * rows_.row(told_row_)).format(kPlain);
      logInfo("row %d of %d: %s kPa", told_row_ + 1, static_cast<int>(rows_.rows()),
              text.str().c_str());
    }
    publishTarget();
    over_ = player_->finished();
    if (over_) logInfo("the series has ended");
  }

  void publishTarget() {
    std_msgs::Header header = toHeaderMsg(ros::Time::now());
    const Eigen::VectorXd target = held_back_ ? command_ : player_->pressure();
    target_publisher_.publish(toPressureMsg(header, scene_.arm, target));
    trace_.sent(header.stamp);
  }

  /// Once no target is on its way any more, asks for rest where the arm follows; ends the node.
  /// Where no target was answered yet, repeats the last one, for CommandTrace::kPatience at most.
  /// Ends after twice that time at the latest.
  void endSeries() {
    if (EndRequest::isUrgent()) return;  // without a master, the call would block
    const ros::SteadyTime now = ros::SteadyTime::now();
    if (end_began_.isZero()) end_began_ = now;
    // The arm may follow a target whose answer came before target_status was connected.
    if (mayBeUnheard() && now - end_began_ < ros::WallDuration(CommandTrace::kPatience)) {
      return publishTarget();
    }
    if (trace_.awaitsAnswer()) return;
    if (trace_.commands()) requestRest();
    EndRequest::make();
  }

  /// Targets were sent and none was answered, neither to this node nor to another that it gives way
  /// to.
  bool mayBeUnheard() const { return trace_.isUnheard() && !yielding_; }

  /// Warns, and ends the node if the trouble persists.
  void suffer(Trouble& trouble, const std::string& what) {
    if (trouble.warnings.add()) logWarning("%s", what.c_str());
    if (!trouble.goesOn() || verdict_ != kDone) return;
    logFatal("%s, and nothing else for %g s", what.c_str(), kLongestTrouble);
    verdict_ = kFailed;
    EndRequest::make();
  }

  const PressureSeriesOptions options_{};
  const io::Scene scene_ = io::loadScene(options_.scene);
  const Eigen::MatrixXd rows_ = loadRows(options_, scene_.arm);  ///< (rows x actuators) [Pa]
  std::optional<procedures::SeriesPlayer> player_;               ///< from the first command on
  Eigen::VectorXd command_;  ///< last one in force, inside the limits [Pa]
  CommandTrace trace_;
  bool over_ = false;  ///< the last row was played
  int told_row_ = -1;
  bool yielding_ = false;
  FaultCount waits_;
  bool held_back_ = false;     ///< targets are dropped for now, whatever their values
  Trouble foreign_, refused_;  ///< commands of another arm; targets refused for their values
  int verdict_ = kDone;
  ros::SteadyTime last_of_others_;
  ros::SteadyTime last_tick_, end_began_;

  ros::NodeHandle node_;
  ros::Publisher target_publisher_;
  ros::Subscriber command_subscriber_, status_subscriber_;
  ros::SteadyTimer timer_;
};

}  // namespace

std::unique_ptr<Node> makePressureSeries() { return std::make_unique<PressureSeriesNode>(); }

}  // namespace helix_arm::ros_bridge
