#pragma once

#include <boost/array.hpp>
#include <diagnostic_msgs/DiagnosticStatus.h>
#include <ros/node_handle.h>

#include "basics/text.hpp"
#include "helix_arm/ErrorBudget.h"
#include "helix_arm/ExternalLoad.h"
#include "helix_arm/LoopStatus.h"
#include "helix_arm/TagDetections.h"
#include "helix_arm/VisionStatus.h"
#include "helix_arm/follow/visual_servo.hpp"
#include "helix_arm/io/scene.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"
#include "path_goal.hpp"
#include "procedures/budget_table.hpp"
#include "procedures/calibration_job.hpp"
#include "procedures/suspect_watch.hpp"
#include "ros_bridge/common/arm_markers.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/diagnostics.hpp"
#include "ros_bridge/common/guarded_callbacks.hpp"
#include "ros_bridge/names.hpp"

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
  void note(double time, const Estimate& estimate) {
    if (time < last_time_) since_.clear();
    last_time_ = time;
    since_.resize(estimate.names.size());
    advice_.clear();
    for (std::size_t k = 0; k < since_.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      const double prior = estimate.prior[i];
      const bool differs =
          std::abs(estimate.value[i]) > kSigmas * prior && estimate.deviation[i] < kKnown * prior;
      since_[k] = differs ? std::optional(since_[k].value_or(time)) : std::nullopt;
      if (!differs || time - *since_[k] < kPatience) continue;
      advice_ += (advice_.empty() ? "" : ", ") + estimate.names[k] +
                 basics::format(" %+.1f %%", 100 * std::expm1(estimate.value[i]));
    }
  }
  /// Part to calibrate again, such as "length of muscle_2 +0.8 %"; empty if nothing.
  const std::string& advice() const { return advice_; }

 private:
  double last_time_ = 0.0;
  std::vector<std::optional<double>> since_;  ///< (parameters)
  std::string advice_;
};

/// Words for a contact, as far as it is known: an arm whose muscles pull otherwise than the scene
/// says seems to be touched.
inline ContactWords contactWords(const procedures::SuspectWatch& suspects) {
  if (!suspects.suspects().empty()) return {"it looks like a contact with the arm", "mend that"};
  if (suspects.isSound()) return {"contact with the arm", "clear the arm"};
  return {"contact with the arm, or its muscles do not pull as the scene says",
          "clear the arm, and check its hoses"};
}

/// A text with the best suspect, if there is one, in front of it.
inline std::string ledBySuspect(const procedures::SuspectWatch& suspects, const std::string& text) {
  const std::vector<std::string> named = procedures::textsOf(suspects.suspects());
  return (named.empty() ? "" : named.front() + "; ") + text;
}

/// Counts pictures, and says how the loop is doing.
class LoopDiagnostics {
 public:
  using DiagnosticStatus = diagnostic_msgs::DiagnosticStatus;

  /// Notes what became of a picture. @param lead  of its stamp over that of the last reading [s].
  /// @param filter  the loop's tracker. @param with_tags  the tags of its fit are known.
  void saw(double time, double lead, const estimation::Observation& observation,
           const estimation::ArmFilter& filter, bool with_tags) {
    using estimation::ObservationFault;
    const bool stamped_wrong = observation.fault == ObservationFault::kFuture ||
                               observation.fault == ObservationFault::kTooOld;
    wrong_stamp_ = stamped_wrong ? wrongStampText(lead, observation.fault) : "";
    if (!observation.accepted()) {
      ++refused_;
      ++by_fault_[static_cast<std::size_t>(observation.fault)];
      return;
    }
    ++accepted_;
    if (!with_tags) ++without_tags_;
    const int count = filter.parameterCount();
    const estimation::Gaussian& state = filter.state();
    const auto names = filter.parameterNames().begin();
    calibration_.note(time, {{names, names + count},
                             state.mean.head(count),
                             state.covariance.diagonal().head(count).cwiseSqrt(),
                             filter.parameterPrior()});
  }
  /// Notes a `measured` that is not of this arm.
  void sawForeign(const std::string& why) {
    ++refused_;
    if (!foreign_.add()) return;
    logWarning("a message on measured was dropped (%lu so far): %s", foreign_.total(), why.c_str());
  }

  std::uint64_t accepted() const { return accepted_; }
  std::uint64_t refused() const { return refused_; }
  /// If the last picture was refused for its stamp: how far that is off, and the remedy; else
  /// empty.
  const std::string& wrongStamp() const { return wrong_stamp_; }

  /// The status `<node>: loop`: its state, pictures by their faults, and suspects.
  DiagnosticStatus loop(const follow::VisualServo& loop, const std::string& message,
                        const std::string& suspects) const {
    DiagnosticStatus out = makeStatus(names::kLoopStatus, levelOf(loop.state()), message,
                                      {{"state", follow::nameOf(loop.state())},
                                       {names::kAcceptedKey, std::to_string(accepted_)},
                                       {names::kWithoutTagsKey, std::to_string(without_tags_)}});
    for (int i = 1; i < estimation::kObservationFaultCount; ++i) {
      const auto fault = static_cast<estimation::ObservationFault>(i);
      addValue(out, names::kRefusedPrefix + std::string(estimation::nameOf(fault)),
               std::to_string(by_fault_[static_cast<std::size_t>(i)]));
    }
    addValue(out, names::kRefusedPrefix + std::string("foreign"), std::to_string(foreign_.total()));
    addValue(out, "tip_sd_mm", fixed(1e3 * loop.tipDeviation(), 2));
    addValue(out, "drift_mm", fixed(1e3 * loop.drift().distance, 2));
    addValue(out, "drift_allowed_mm", fixed(1e3 * loop.drift().allowed, 2));
    addValue(out, "error_mm", loop.error() ? fixed(1e3 * *loop.error(), 2) : "");
    addValue(out, "suspects", suspects);
    addValue(out, "contact_watch", loop.load().blind ? procedures::kContactBlind : "works");
    return out;
  }
  /// The status `<node>: correction`: how the arm differs from its model; WARN if it is to be
  /// calibrated again.
  DiagnosticStatus correction(const follow::VisualServo& loop) const {
    const estimation::ArmFilter& filter = loop.tracker();
    const estimation::Gaussian& state = filter.state();
    const std::string& advice = calibration_.advice();
    DiagnosticStatus out = makeStatus(
        "correction", advice.empty() ? DiagnosticStatus::OK : DiagnosticStatus::WARN,
        advice.empty() ? "the arm is as its calibration says" : "calibrate again: " + advice);
    const auto add = [&out](const std::string& what, double value, double deviation, int decimals) {
      addValue(out, what, fixed(value, decimals) + " +- " + fixed(deviation, decimals));
    };
    for (int i = 0; i < filter.parameterCount(); ++i) {
      const double deviation = std::sqrt(std::max(0.0, state.covariance(i, i)));
      add(filter.parameterNames()[static_cast<std::size_t>(i)] + " [%]",
          100 * std::expm1(state.mean[i]), 100 * std::expm1(deviation), 2);
    }
    const estimation::Estimated lag = loop.response().lag(), play = loop.response().play();
    if (lag.deviation > 0) {
      add("lag [s]", lag.value, lag.deviation, 3);
      add("play [kPa]", 1e-3 * play.value, 1e-3 * play.deviation, 1);
    }
    if (const auto& mode = loop.mode()) {
      add("mode [Hz]", mode->frequency, mode->frequency_deviation, 2);
      add("damping of the mode", mode->damping, mode->damping_deviation, 3);
    }
    const auto& rows = filter.rows();
    for (std::size_t k = 0; k < rows.size(); ++k) {
      const bool moves = rows[k] % 6 < 3;
      addValue(out,
               "bias of section " + std::to_string(rows[k] / 6 + 1) + ", " + (moves ? "v_" : "w_") +
                   "xyz"[rows[k] % 3] + (moves ? " [mm]" : " [mrad]"),
               fixed(1e3 * state.mean[filter.parameterCount() + static_cast<Eigen::Index>(k)], 2));
    }
    return out;
  }

 private:
  static std::uint8_t levelOf(follow::LoopState state) {
    if (state == follow::LoopState::kDiverging) return DiagnosticStatus::ERROR;
    const bool fine = state == follow::LoopState::kIdle || state == follow::LoopState::kClosed;
    return fine ? DiagnosticStatus::OK : DiagnosticStatus::WARN;
  }
  static std::string wrongStampText(double lead, estimation::ObservationFault fault) {
    return "the last picture is stamped " + fixed(std::abs(lead), 2) + " s " +
           (lead > 0 ? "after" : "before") + " the last reading of the pressures, and refused (" +
           estimation::nameOf(fault) + "): " +
           (lead > 0
                ? "synchronise the clocks of camera and arm"
                : control::whyLate(-lead) + std::string(", or shorten the delay of the pictures"));
  }

  std::uint64_t accepted_ = 0, refused_ = 0;
  std::uint64_t without_tags_ = 0;  ///< of accepted_
  std::array<std::uint64_t, estimation::kObservationFaultCount> by_fault_ = {};
  std::string wrong_stamp_;
  FaultCount foreign_;
  CalibrationWatch calibration_;
};

/// The arm as one picture shows it.
struct SeenArm {
  ros::Time stamp;  ///< of the picture
  model::Shape shape;
  Eigen::MatrixXd covariance;  ///< of its twists
  /// Indices in the layout of the tags that were fitted, ascending; nothing if unknown.
  std::optional<std::vector<int>> tags = {};
};

/// Indices in the layout of the tags that a fit used, ascending; nothing if there is none, or if
/// one of them is not in the layout.
inline std::optional<std::vector<int>> fittedTags(const TagDetections& detections,
                                                  const estimation::TagLayout& layout) {
  std::vector<int> out;
  for (const TagDetection& tag : detections.tags) {
    if (!tag.fitted) continue;
    const int index = layout.find(tag.id);
    if (index < 0) return std::nullopt;
    // From a message with any number of tags, no more than the layout has are kept.
    const auto place = std::lower_bound(out.begin(), out.end(), index);
    if (place == out.end() || *place != index) out.insert(place, index);
  }
  if (out.empty()) return std::nullopt;
  return out;
}

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
  std::optional<SeenArm> take(double now) {
    if (shapes_.empty()) return std::nullopt;
    Waiting& first = shapes_.front();
    const auto of_it = std::find_if(tags_.begin(), tags_.end(), [&first](const Tags& tags) {
      return tags.stamp == first.seen.stamp;
    });
    if (of_it == tags_.end() && mayGetTags(first, now)) return std::nullopt;
    std::optional<SeenArm> out = std::move(first.seen);
    shapes_.pop_front();
    if (of_it != tags_.end()) out->tags = of_it->fitted;
    return out;
  }
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
  /// @param scene, loop, pictures, suspects  Kept by reference.
  /// @param rate       Maximum of status and estimate [Hz].
  /// @param draw_rate  Of draw() [Hz].
  /// @param on_target  As TipHandle's; empty: no handle.
  LoopPublisher(ros::NodeHandle& node, const io::Scene& scene, const follow::VisualServo& loop,
                const LoopDiagnostics& pictures,
                const std::optional<procedures::SuspectWatch>& suspects, std::string base_frame,
                double rate, double draw_rate, TipHandle::OnTarget on_target)
      : scene_(scene),
        loop_(loop),
        pictures_(pictures),
        suspects_(suspects),
        base_frame_(std::move(base_frame)),
        period_(kSlack / rate),
        markers_(base_frame_, 1.0 / draw_rate),
        status_publisher_(node.advertise<LoopStatus>(names::kVisualServoStatus, 10)),
        estimate_publisher_(node.advertise<ArmShape>(names::kEstimate, 10)),
        marker_publisher_(node.advertise<visualization_msgs::MarkerArray>(names::kLoopMarkers, 2)),
        budget_publisher_(node.advertise<ErrorBudget>(names::kErrorBudget, 10)),
        load_publisher_(node.advertise<ExternalLoad>(names::kExternalLoad, 10, true)) {
    if (on_target) handle_ = std::make_unique<TipHandle>(base_frame_, scene, std::move(on_target));
  }
  /// After a turn: publishes status and estimate, at a change of state, else at this rate; and the
  /// load, if its state has changed without a picture, as by a lack of pictures.
  /// @param stamp         of the turn.
  /// @param last_picture  that the loop used.
  /// @param commander     empty if nobody commands.
  /// @param message       why the loop is in its state.
  void publish(const ros::Time& stamp, const std::optional<ros::Time>& last_picture,
               const std::string& commander, const std::string& message) {
    if (!last_load_.empty() && loadState() != last_load_) tellLoad(stamp);
    const estimation::ExternalLoad& load = loop_.load();
    const bool touched = load.contact && loop_.sees();
    tips_.force = touched ? std::optional(load.force) : std::nullopt;
    contact_ = touched ? "\ncontact" : "";
    if (touched && !load.normalised) contact_ += ", " + fixed(load.force.norm(), 2) + " N";
    const follow::Turn& turn = loop_.turn();
    const double since = secondsBetween(status_.header.stamp, stamp);
    if (since >= 0 && since < period_ && status_.state == follow::nameOf(loop_.state())) return;
    const auto& budget = loop_.budget();
    const bool fresh =
        last_picture && std::abs(secondsBetween(*last_picture, stamp)) < kFreshBudget;
    tips_.budget = budget && fresh ? procedures::budgetText(*budget) : std::string();
    tips_.outside = isOutside();
    const auto prediction = loop_.prediction();
    if (prediction) publishEstimate(stamp, *prediction);
    tips_.covariance =
        prediction ? prediction->tip_covariance : Eigen::Matrix3d(Eigen::Matrix3d::Zero());
    tips_.wanted = turn.commands ? std::optional(turn.wanted.translation) : std::nullopt;
    tips_.predicted = turn.predicted ? std::optional(turn.predicted->translation) : std::nullopt;
    status_ = statusOf(stamp, tips_.covariance);
    status_.commander = commander;
    status_.message = message;
    status_publisher_.publish(status_);
  }
  /// After a picture that the loop used, or a change of the loop itself such as a reset. A budget
  /// of this picture is published at most at 5 Hz; the load on every change, and with every picture
  /// while something touches the arm.
  /// @param moved  VisionStatus::base_moved.
  void publishLoad(const ros::Time& picture, const std::string& moved) {
    const double since = secondsBetween(last_budget_, picture);
    // During a contact that is not doubted the budget is that of an earlier picture.
    const bool present = loop_.budget() && loop_.budget()->time == picture.toSec();
    if (present && (since < 0 || since >= kBudgetPeriod))
      publishBudget(picture, *loop_.budget(), moved);
    tellLoad(picture);
  }
  /// Draws what was published last.
  void draw() {
    LoopMarkers::Tips tips = tips_;
    if (!tips.predicted) tips.curve.clear();
    tips.text = status_.state;
    if (std::isfinite(status_.error)) tips.text += ", " + fixed(1e3 * status_.error, 2) + " mm";
    tips.text += contact_;
    marker_publisher_.publish(markers_.draw(ros::Time::now(), sideViewOf(scene_), tips));
    if (!handle_) return;
    if (const auto& at = tips.wanted ? tips.wanted : tips.predicted) {
      handle_->follow({Eigen::Matrix3d::Identity(), *at});
    }
  }
  /// Nothing is measured any more: the next drawing removes all.
  void clear() {
    status_ = {};
    tips_ = {};
    contact_.clear();
  }

 private:
  // Readings are not exactly periodic; one slightly early must not be skipped.
  static constexpr double kSlack = 0.9;
  static constexpr int kEstimatePoints = 24;    ///< of the drawn curve, a section
  static constexpr double kFreshBudget = 1.0;   ///< since its picture [s]
  static constexpr double kBudgetPeriod = 0.2;  ///< [s]
  static constexpr char kUnexplained[] =
      "the calibration does not explain the arm's shape: a load, slip, a changed muscle, or a "
      "camera that has moved";

  /// State of the load: what acts on the arm, as far as it is seen.
  const std::string& loadState() const {
    if (!loop_.sees()) return ExternalLoad::UNSEEN;
    if (loop_.load().contact) return ExternalLoad::CONTACT;
    return isOutside() ? ExternalLoad::OUTSIDE_BUDGET : ExternalLoad::NONE;
  }
  bool isOutside() const {
    return loop_.budget() && loop_.budget()->state == estimation::BudgetState::kOutside;
  }

  void publishEstimate(const ros::Time& stamp, const follow::Prediction& prediction) {
    const model::Shape& shape = prediction.shape;
    tips_.curve.clear();
    for (const auto& point : model::sampleToTip(shape, shape.sectionCount() * kEstimatePoints)) {
      tips_.curve.push_back(point.X.translation);
    }
    const std_msgs::Header header = toHeaderMsg(stamp, base_frame_);
    estimate_publisher_.publish(toShapeMsg(header, "estimated", shape, prediction.covariance));
  }

  LoopStatus statusOf(const ros::Time& stamp, const Eigen::Matrix3d& tip_covariance) const {
    const follow::Turn& turn = loop_.turn();
    LoopStatus out;
    out.header = toHeaderMsg(stamp, base_frame_);
    out.state = follow::nameOf(turn.state);
    out.path_time = std::numeric_limits<double>::quiet_NaN();
    out.has_wanted = turn.commands;
    if (turn.commands) {
      out.wanted = toPoseMsg(turn.wanted);
      out.inverse = inverseWord(turn.status);
      out.residual = turn.residual;
      out.at_lower_limit = namesAt(statics::Limit::kLower, scene_.arm, turn.limits);
      out.at_upper_limit = namesAt(statics::Limit::kUpper, scene_.arm, turn.limits);
      if (turn.path_time) out.path_time = *turn.path_time;
    }
    out.has_predicted = turn.predicted.has_value();
    if (turn.predicted) {
      out.predicted = toPoseMsg(*turn.predicted);
      out.predicted_covariance = toCovarianceMsg(tip_covariance);
      out.predicted_sd = estimation::TipSpread{tip_covariance}.deviation();
    }
    out.error = loop_.error().value_or(std::numeric_limits<double>::quiet_NaN());
    out.accepted = pictures_.accepted();
    out.refused = pictures_.refused();
    return out;
  }

  void publishBudget(const ros::Time& picture, const estimation::TipErrorBudget& budget,
                     const std::string& moved) {
    last_budget_ = picture;
    ErrorBudget out;
    out.header = toHeaderMsg(picture, base_frame_);
    for (int i = 0; i < estimation::kBudgetPartCount; ++i) {
      const auto part = static_cast<estimation::BudgetPart>(i);
      const estimation::TipSpread& spread = budget.part(part);
      out.names.emplace_back(nameOf(part));
      out.covariance.insert(out.covariance.end(), spread.covariance.data(),
                            spread.covariance.data() + 9);
      out.sd.push_back(spread.deviation());
    }
    out.predicted = toCovarianceMsg(budget.predicted.covariance);
    out.predicted_sd = budget.predicted.deviation();
    out.open_loop = toCovarianceMsg(budget.open_loop.covariance);
    out.open_loop_sd = budget.open_loop.deviation();
    out.error = toVectorMsg(budget.error);
    out.distance2 = budget.distance2;
    out.limit = budget.limit;
    out.state = moved.empty() ? nameOf(budget.state) : ErrorBudget::OUTSIDE;
    if (!moved.empty()) {
      out.message = moved;
    } else if (loop_.drift().doubtful) {
      out.message = procedures::driftText(loop_.drift());
    } else if (isOutside()) {
      out.message = std::string(kUnexplained) + "; check the arm, then calibrate again";
    }
    budget_publisher_.publish(out);
  }

  void tellLoad(const ros::Time& stamp) {
    const std::string& state = loadState();
    const bool touched = state == ExternalLoad::CONTACT;
    if (!touched && state == last_load_) return;
    last_load_ = state;
    const estimation::ExternalLoad& load = loop_.load();
    ExternalLoad out;
    out.state = state;
    out.header = toHeaderMsg(stamp, base_frame_);
    if (state != ExternalLoad::UNSEEN) out.score = load.score;
    out.limit = loop_.contactLimit();
    out.s = std::numeric_limits<double>::quiet_NaN();
    out.normalised = load.normalised;
    if (touched) {
      out.onset = ros::Time(load.onset);
      if (load.place) {
        out.section = load.place->section + 1;
        out.s = load.place->s;
      }
      out.force = toVectorMsg(load.force);
      out.covariance = toCovarianceMsg(load.covariance);
      out.determined.assign(load.determined.data(),
                            load.determined.data() + load.determined.size());
      const ContactWords words = contactWords(*suspects_);
      const bool named = !suspects_->suspects().empty();
      out.message =
          ledBySuspect(*suspects_, words.what + "; " + (named ? words.remedy : "clear it") +
                                       ", or accept the load (on_contact: report)");
    } else if (state == ExternalLoad::OUTSIDE_BUDGET) {
      out.message = loop_.drift().doubtful ? procedures::driftText(loop_.drift()) : kUnexplained;
    } else if (state == ExternalLoad::UNSEEN) {
      out.message =
          std::string("the arm is not seen, so what acts on it is not known; ") + kCheckVision;
    }
    load_publisher_.publish(out);
  }

  /// Row by row.
  static boost::array<double, 9> toCovarianceMsg(const Eigen::Matrix3d& covariance) {
    boost::array<double, 9> out;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(out.data()) = covariance;
    return out;
  }

  const io::Scene& scene_;
  const follow::VisualServo& loop_;
  const LoopDiagnostics& pictures_;
  const std::optional<procedures::SuspectWatch>& suspects_;
  const std::string base_frame_;
  const double period_;  ///< of the status [s]
  LoopMarkers markers_;
  LoopStatus status_;       ///< the last one
  LoopMarkers::Tips tips_;  ///< what of it is drawn, without the text
  std::string contact_;     ///< in words
  ros::Time last_budget_;
  std::string last_load_;  ///< its state
  const ros::Publisher status_publisher_, estimate_publisher_, marker_publisher_, budget_publisher_,
      load_publisher_;
  std::unique_ptr<TipHandle> handle_;
};

}  // namespace helix_arm::ros_bridge
