#include "loop_reports.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "helix_arm/ErrorBudget.h"
#include "helix_arm/ExternalLoad.h"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/localization/twist_fit.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/procedures/budget_table.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/ros_time.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {

void CalibrationWatch::note(double time, const Estimate& estimate) {
  if (time < last_time_) since_.clear();
  last_time_ = time;
  since_.resize(estimate.names.size());
  advice_.clear();
  for (std::size_t k = 0; k < since_.size(); ++k) {
    const auto i = static_cast<Eigen::Index>(k);
    const double prior = estimate.prior[i];
    const bool differs =
        std::abs(estimate.value[i]) > kSigmas * prior && estimate.deviation[i] < kKnown * prior;
    if (!differs) {
      since_[k].reset();
      continue;
    }
    if (!since_[k]) since_[k] = time;
    if (time - *since_[k] < kPatience) continue;
    advice_ += (advice_.empty() ? "" : ", ") + estimate.names[k] +
               basics::format(" %+.1f %%", 100 * std::expm1(estimate.value[i]));
  }
}

namespace {

using diagnostic_msgs::DiagnosticStatus;
using follow::LoopState;

std::uint8_t levelOf(LoopState state) {
  if (state == LoopState::kDiverging) return DiagnosticStatus::ERROR;
  const bool fine = state == LoopState::kIdle || state == LoopState::kClosed;
  return fine ? DiagnosticStatus::OK : DiagnosticStatus::WARN;
}

std::string wrongStampText(double lead, estimation::ObservationFault fault) {
  return "the last picture is stamped " + fixed(std::abs(lead), 2) + " s " +
         (lead > 0 ? "after" : "before") + " the last reading of the pressures, and refused (" +
         estimation::nameOf(fault) + "): synchronise the clocks of camera and arm" +
         (lead > 0 ? "" : ", or shorten the delay of the pictures");
}

std::string percent(double logarithm) { return fixed(100 * std::expm1(logarithm), 2); }

// Readings are not exactly periodic; one slightly early must not be skipped.
constexpr double kSlack = 0.9;
constexpr int kEstimatePoints = 24;   // of the drawn curve, a section
constexpr double kFreshBudget = 1.0;  // since its picture [s]

// Covariance of the filter's shape at the present pressures.
Eigen::MatrixXd twistCovariance(const LoopPublisher::View& view) {
  const double elapsed =
      view.last_picture ? std::max(0.0, secondsBetween(*view.last_picture, view.stamp)) : 0.0;
  return view.loop.tracker().twistCovariance(elapsed);
}

constexpr double kBudgetPeriod = 0.2;  // [s]
constexpr char kUnexplained[] =
    "the calibration does not explain the arm's shape: a load, slip, a changed muscle, or a camera "
    "that has moved";

const std::string& stateOf(const follow::VisualServo& loop) {
  if (!loop.sees()) return ExternalLoad::UNSEEN;
  if (loop.load().contact) return ExternalLoad::CONTACT;
  const bool outside = loop.budget() && loop.budget()->state == estimation::BudgetState::kOutside;
  return outside ? ExternalLoad::OUTSIDE_BUDGET : ExternalLoad::NONE;
}

}  // namespace

void LoopDiagnostics::saw(double time, double lead, const estimation::Observation& observation,
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
  const int count = filter.factorCount();
  const estimation::Gaussian& state = filter.state();
  const auto names = filter.parameterNames().begin();
  calibration_.note(time, {{names, names + count},
                           state.mean.head(count),
                           state.covariance.diagonal().head(count).cwiseSqrt(),
                           filter.parameterPrior()});
}

void LoopDiagnostics::sawForeign(const std::string& why) {
  ++refused_;
  if (!foreign_.add()) return;
  logWarning("a message on measured was dropped (%lu so far): %s", foreign_.total(), why.c_str());
}

DiagnosticStatus LoopDiagnostics::loop(const follow::VisualServo& loop,
                                       const std::string& message) const {
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
  addValue(out, "contact_watch", loop.load().blind ? procedures::kContactBlind : "works");
  return out;
}

DiagnosticStatus LoopDiagnostics::correction(const follow::VisualServo& loop) const {
  const estimation::ArmFilter& filter = loop.tracker();
  const estimation::Gaussian& state = filter.state();
  const std::string& advice = calibration_.advice();
  DiagnosticStatus out = makeStatus(
      "correction", advice.empty() ? DiagnosticStatus::OK : DiagnosticStatus::WARN,
      advice.empty() ? "the arm is as its calibration says" : "calibrate again: " + advice);
  for (int i = 0; i < filter.factorCount(); ++i) {
    addValue(out, filter.parameterNames()[static_cast<std::size_t>(i)] + " [%]",
             percent(state.mean[i]) + " +- " +
                 percent(std::sqrt(std::max(0.0, state.covariance(i, i)))));
  }
  if (filter.parameterCount() > filter.factorCount()) {
    addValue(out, "lag [s]", fixed(filter.lag(), 3));
  }
  if (const auto& mode = loop.mode()) {
    addValue(out, "mode [Hz]",
             fixed(mode->frequency, 2) + " +- " + fixed(mode->frequency_deviation, 2));
    addValue(out, "damping of the mode",
             fixed(mode->damping, 3) + " +- " + fixed(mode->damping_deviation, 3));
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

std::optional<std::vector<int>> fittedTags(const TagDetections& detections,
                                           const estimation::TagLayout& layout) {
  std::vector<int> out;
  for (const TagDetection& tag : detections.tags) {
    if (!tag.fitted) continue;
    const int index = layout.find(tag.id);
    if (index < 0) return std::nullopt;
    // Of a message with any number of tags, no more than the layout has are kept.
    const auto place = std::lower_bound(out.begin(), out.end(), index);
    if (place == out.end() || *place != index) out.insert(place, index);
  }
  if (out.empty()) return std::nullopt;
  return out;
}

std::optional<SeenArm> TagMatcher::take(double now) {
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

LoopPublisher::LoopPublisher(ros::NodeHandle& node, const io::Scene& scene, std::string base_frame,
                             double rate, double draw_rate, TipHandle::OnTarget on_target)
    : scene_(scene),
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

Eigen::Matrix3d LoopPublisher::tipCovariance(const View& view) {
  const auto& tracker = view.loop.tracker();
  const auto shape = tracker.shape(view.loop.observer().newest().pressure);
  if (!shape) return Eigen::Matrix3d::Zero();
  return estimation::tipCovariance(*shape, twistCovariance(view));
}

void LoopPublisher::publish(const View& view) {
  if (!last_load_.empty() && stateOf(view.loop) != last_load_) tellLoad(view.stamp, view.loop);
  const estimation::ExternalLoad& load = view.loop.load();
  const bool touched = load.contact && view.loop.sees();
  tips_.force = touched ? std::optional(load.force) : std::nullopt;
  contact_ = touched ? "\ncontact" : "";
  if (touched && !load.normalised) contact_ += ", " + fixed(load.force.norm(), 2) + " N";
  const follow::Turn& turn = view.loop.turn();
  const double since = secondsBetween(status_.header.stamp, view.stamp);
  if (since >= 0 && since < period_ && status_.state == follow::nameOf(view.loop.state())) return;
  noteBudget(view);
  publishEstimate(view);
  tips_.covariance = tipCovariance(view);
  tips_.wanted = turn.commands ? std::optional(turn.wanted.translation) : std::nullopt;
  tips_.predicted = turn.predicted ? std::optional(turn.predicted->translation) : std::nullopt;
  status_ = statusOf(view, tips_.covariance);
  status_publisher_.publish(status_);
}

void LoopPublisher::noteBudget(const View& view) {
  const auto& budget = view.loop.budget();
  const bool fresh =
      view.last_picture && std::abs(secondsBetween(*view.last_picture, view.stamp)) < kFreshBudget;
  tips_.budget = budget && fresh ? procedures::budgetText(*budget) : std::string();
  tips_.outside = budget && budget->state == estimation::BudgetState::kOutside;
}

void LoopPublisher::publishEstimate(const View& view) {
  const auto shape = view.loop.tracker().shape(view.loop.observer().newest().pressure);
  if (!shape) return;
  tips_.curve.clear();
  for (const auto& point : model::sampleToTip(*shape, shape->sectionCount() * kEstimatePoints)) {
    tips_.curve.push_back(point.X.translation);
  }
  const std_msgs::Header header = toHeaderMsg(view.stamp, base_frame_);
  estimate_publisher_.publish(toShapeMsg(header, "estimated", *shape, twistCovariance(view)));
}

LoopStatus LoopPublisher::statusOf(const View& view, const Eigen::Matrix3d& tip_covariance) const {
  const follow::Turn& turn = view.loop.turn();
  LoopStatus out;
  out.header = toHeaderMsg(view.stamp, base_frame_);
  out.state = follow::nameOf(turn.state);
  out.message = view.message;
  out.commander = view.commander;
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
  out.error = view.loop.error().value_or(std::numeric_limits<double>::quiet_NaN());
  out.accepted = view.pictures.accepted();
  out.refused = view.pictures.refused();
  return out;
}

void LoopPublisher::draw() {
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

void LoopPublisher::publishLoad(const ros::Time& picture, const follow::VisualServo& loop) {
  const double since = secondsBetween(last_budget_, picture);
  // During a contact that is not doubted the budget is that of an earlier picture.
  const bool present = loop.budget() && loop.budget()->time == picture.toSec();
  if (present && (since < 0 || since >= kBudgetPeriod)) {
    publishBudget(picture, *loop.budget(), loop.drift());
  }
  tellLoad(picture, loop);
}

void LoopPublisher::publishBudget(const ros::Time& picture,
                                  const estimation::TipErrorBudget& budget,
                                  const estimation::Drift& drift) {
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
  out.state = nameOf(budget.state);
  if (drift.doubtful) {
    out.message = procedures::driftText(drift);
  } else if (budget.state == estimation::BudgetState::kOutside) {
    out.message = std::string(kUnexplained) + "; check the arm, then calibrate again";
  }
  budget_publisher_.publish(out);
}

void LoopPublisher::tellLoad(const ros::Time& stamp, const follow::VisualServo& loop) {
  const std::string& state = stateOf(loop);
  const bool touched = state == ExternalLoad::CONTACT;
  if (!touched && state == last_load_) return;
  last_load_ = state;
  const estimation::ExternalLoad& load = loop.load();
  ExternalLoad out;
  out.state = state;
  out.header = toHeaderMsg(stamp, base_frame_);
  if (state != ExternalLoad::UNSEEN) out.score = load.score;
  out.limit = loop.contactLimit();
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
    out.determined.assign(load.determined.data(), load.determined.data() + load.determined.size());
    out.message = "contact with the arm; clear it, or accept the load (on_contact: report)";
  } else if (state == ExternalLoad::OUTSIDE_BUDGET) {
    out.message = loop.drift().doubtful ? procedures::driftText(loop.drift()) : kUnexplained;
  } else if (state == ExternalLoad::UNSEEN) {
    out.message =
        "the arm is not seen, so what acts on it is not known; check the camera (vision_status)";
  }
  load_publisher_.publish(out);
}

}  // namespace helix_arm::ros_bridge
