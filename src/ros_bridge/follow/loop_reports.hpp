#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>

#include "helix_arm/LoopStatus.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/tag_layout.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/common/diagnostics.hpp"

namespace helix_arm::ros_bridge {

/// Notices that the arm differs lastingly from its calibration: parameters that lie beyond
/// kSigmas of their prior deviations for kPatience, and are known better than kKnown of these.
class CalibrationWatch {
 public:
  static constexpr double kPatience = 60.0;  ///< [s]
  static constexpr double kSigmas = 3.0;
  static constexpr double kKnown = 1.0 / 3.0;

  /// Logarithms of the factors on parameters of the arm, with their standard deviations.
  struct Estimate {
    const std::vector<std::string>& names;
    const Eigen::VectorXd& value;      ///< (parameters)
    const Eigen::VectorXd& deviation;  ///< (parameters)
    const Eigen::VectorXd& prior;      ///< (parameters) deviations of the calibration
  };

  /// Notes an estimate. @param time  [s]; one before the last starts anew.
  void note(double time, const Estimate& estimate);
  /// What to calibrate again, such as "length of muscle_2 +0.8 %"; empty if nothing.
  const std::string& advice() const { return advice_; }

 private:
  double last_time_ = 0.0;
  std::vector<std::optional<double>> since_;  ///< (parameters)
  std::string advice_;
};

/// Counts pictures, and says how the loop is doing.
class LoopDiagnostics {
 public:
  /// Notes what became of a picture. @param lead  of its stamp over that of the last reading [s].
  /// @param filter  the loop's tracker. @param with_tags  the tags of its fit are known.
  void saw(double time, double lead, const estimation::Observation& observation,
           const estimation::ArmFilter& filter, bool with_tags);
  /// Notes a `measured` that is not of this arm.
  void sawForeign(const std::string& why);

  std::uint64_t accepted() const { return accepted_; }
  std::uint64_t refused() const { return refused_; }
  /// If the last picture was refused for its stamp: how far that is off, and the remedy; else
  /// empty.
  const std::string& wrongStamp() const { return wrong_stamp_; }

  /// The status `<node>: loop`: its state, and pictures by their faults.
  diagnostic_msgs::DiagnosticStatus loop(const follow::VisualServo& loop,
                                         const std::string& message) const;
  /// The status `<node>: correction`: how the arm differs from its model; WARN if it is to be
  /// calibrated again.
  diagnostic_msgs::DiagnosticStatus correction(const follow::VisualServo& loop) const;

 private:
  std::uint64_t accepted_ = 0, refused_ = 0;
  std::uint64_t without_tags_ = 0;  ///< of accepted_
  std::array<std::uint64_t, estimation::kObservationFaultCount> by_fault_ = {};
  std::string wrong_stamp_;
  FaultCount foreign_;
  CalibrationWatch calibration_;
};

/// What one picture says of the arm.
struct SeenArm {
  ros::Time stamp;  ///< of the picture
  model::Shape shape;
  Eigen::MatrixXd covariance;  ///< of its twists
  /// Indices in the layout of the tags that were fitted, ascending; nothing if unknown.
  std::optional<std::vector<int>> tags = {};
};

/// Indices in the layout of the tags that a fit used, ascending; nothing if there is none, or if
/// one of them is not in the layout.
std::optional<std::vector<int>> fittedTags(const TagDetections& detections,
                                           const estimation::TagLayout& layout);

/// Joins each measured shape with the tags of its fit, by their stamps. They come on two topics, in
/// any order.
///
/// A shape waits for its tags at most kPatience; not at all once later tags have come, or where no
/// tags have come for kSilence. It then goes on without them. Shapes keep their order. At most
/// kMost shapes and kMost sets of tags are kept. Time is a number [s].
class TagMatcher {
 public:
  static constexpr double kPatience = 0.05;  ///< [s]
  static constexpr double kSilence = 1.0;    ///< [s]
  static constexpr std::size_t kMost = 8;

  void add(SeenArm seen, double now) { shapes_.push_back({std::move(seen), now}); }
  /// @param tags  as SeenArm's.
  void addTags(const ros::Time& stamp, std::optional<std::vector<int>> tags, double now) {
    if (!tags_.empty() && stamp < tags_.back().stamp) tags_.clear();  // a jump back in time
    tags_.push_back({stamp, std::move(tags)});
    if (tags_.size() > kMost) tags_.pop_front();
    last_tags_ = now;
  }
  /// The next shape that need not wait any more; nothing if there is none.
  std::optional<SeenArm> take(double now);
  /// Forgets shapes and tags.
  void clear() {
    shapes_.clear();
    tags_.clear();
  }

 private:
  struct Waiting {
    SeenArm seen;
    double since;  ///< [s]
  };
  struct Tags {
    ros::Time stamp;
    std::optional<std::vector<int>> fitted;
  };

  bool mayGetTags(const Waiting& shape, double now) const {
    const bool come = last_tags_ && now - *last_tags_ <= kSilence;
    const bool passed = !tags_.empty() && tags_.back().stamp > shape.seen.stamp;
    return come && !passed && now - shape.since <= kPatience && shapes_.size() <= kMost;
  }

  std::deque<Waiting> shapes_;  ///< as they came
  std::deque<Tags> tags_;       ///< by ascending stamp
  std::optional<double> last_tags_;
};

/// Publishes loop_status, estimate, loop_markers, error_budget and external_load, and holds the tip
/// handle at the wanted tip. For the thread of the node's callback queue.
class LoopPublisher {
 public:
  /// The loop after a turn.
  struct View {
    ros::Time stamp;  ///< of the turn
    const follow::VisualServo& loop;
    std::optional<ros::Time> last_picture;  ///< that the loop used
    std::string commander;                  ///< empty if nobody commands
    std::string message;                    ///< why it is in its state
    const LoopDiagnostics& pictures;
  };

  /// @param scene      Kept by reference.
  /// @param rate       Maximum of status and estimate [Hz].
  /// @param draw_rate  Of draw() [Hz].
  /// @param on_target  As TipHandle's; empty: no handle.
  LoopPublisher(ros::NodeHandle& node, const io::Scene& scene, std::string base_frame, double rate,
                double draw_rate, TipHandle::OnTarget on_target);

  /// After a turn: publishes status and estimate, at a change of state, else at this rate; and the
  /// load, if its state has changed without a picture, as by a lack of pictures.
  void publish(const View& view);
  /// After a picture that the loop used, or a change of the loop itself such as a reset. A budget
  /// of this picture is published at most at 5 Hz; the load on every change, and with every picture
  /// while something touches the arm.
  void publishLoad(const ros::Time& picture, const follow::VisualServo& loop);
  /// Draws what was published last.
  void draw();
  /// Nothing is measured any more: the next drawing removes all.
  void clear() {
    status_ = {};
    tips_ = {};
    contact_.clear();
  }
  /// Covariance of the predicted tip's position, base frame [m^2].
  static Eigen::Matrix3d tipCovariance(const View& view);

 private:
  LoopStatus statusOf(const View& view, const Eigen::Matrix3d& tip_covariance) const;
  void publishEstimate(const View& view);
  void noteBudget(const View& view);
  void publishBudget(const ros::Time& picture, const estimation::TipErrorBudget& budget,
                     const estimation::Drift& drift);
  void tellLoad(const ros::Time& stamp, const follow::VisualServo& loop);

  const io::Scene& scene_;
  const std::string base_frame_;
  const double period_;  ///< of the status [s]
  LoopMarkers markers_;
  LoopStatus status_;       ///< the last one
  LoopMarkers::Tips tips_;  ///< what of it is drawn, without the text
  std::string contact_;     ///< in words
  ros::Time last_budget_;
  std::string last_load_;  ///< its state
  ros::Publisher status_publisher_, estimate_publisher_, marker_publisher_, budget_publisher_,
      load_publisher_;
  std::unique_ptr<TipHandle> handle_;
};

}  // namespace helix_arm::ros_bridge
