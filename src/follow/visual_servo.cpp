#include "helix_arm/follow/visual_servo.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "aim.hpp"
#include "arm_swing.hpp"
#include "basics/pi.hpp"
#include "helix_arm/control/pressure_observer.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/tracking/arm_filter.hpp"
#include "helix_arm/tracking/response_estimator.hpp"
#include "helix_arm/tracking/tip_compliance.hpp"
#include "loop_watches.hpp"
#include "path_memory.hpp"
#include "response_tracker.hpp"

namespace helix_arm::follow {
namespace {

constexpr int kClosingPictures = 3;      // accepted within kClosingTime close the loop
constexpr double kClosingTime = 0.5;     // [s]
constexpr double kSureTip = 0.01;        // largest uncertainty at which the loop closes [m]
constexpr double kFadeTime = 1.0 / 3.0;  // time constant of values that fade within a second [s]
constexpr double kLongestTurn = 1.0;     // a longer pause counts as this [s]
constexpr double kOldestPicture = 1.0;   // before the readings [s]
constexpr double kShortApproach = 0.04;  // of 2 mm; a path then begins immediately [s]
constexpr double kArrived = 3e3;         // of the command, all effective pressures [Pa]
constexpr double kFaded = 3.0;           // time constants after which 5 % of a lag are left
constexpr double kSettledWithin = 1e4;   // of the set point or their usual distance, a reading [Pa]
constexpr double kUsualTime = 5.0;       // time constant of that distance [s]

// Root mean square of a swing, relative to its peak.
constexpr double kSwingSpread = 0.7;
constexpr double kShortestRamp = 1e-3;  // of a step [s]
constexpr double kAhead = 0.1;          // of the velocities between which a path accelerates [s]
constexpr double kLearntTime = 0.05;    // time constant of what is learnt of a path [s]
constexpr double kBefore = 5.0;         // of a path, while correction, lag and mode are found [s]
constexpr double kLeastReach = 0.005;   // within which places of a path are alike [m]
constexpr double kSlowSwing = 1.5;      // frequency of an arm whose mode is not known [Hz]

constexpr int kMostTurns = 2048;  // history of the wanted tip

// The wanted tip at one time, base frame.
struct Wanted {
  Eigen::Vector3d place, velocity;  // [m], [m/s]
};

// When pictures arrived and were accepted, and how well the tip is known from them.
struct Sight {
  std::array<double, kClosingPictures> accepted_at = farPast();  // arrivals, newest first [s]
  double arrived_at = -std::numeric_limits<double>::infinity();  // a picture, if refused too [s]
  double seen_at = 0.0;  // stamp of the last accepted picture [s]
  double tip_deviation = std::numeric_limits<double>::infinity();  // [m]

  static std::array<double, kClosingPictures> farPast() {
    std::array<double, kClosingPictures> out;
    out.fill(-std::numeric_limits<double>::infinity());
    return out;
  }
  double unseen(double now) const { return now - accepted_at[0]; }
  // Whether the loop may close.
  bool suffices(double now, double stale_after) const {
    return now - accepted_at.back() <= kClosingTime && unseen(now) <= stale_after &&
           tip_deviation < kSureTip;
  }
  void accept(double now, double stamp, double deviation) {
    std::rotate(accepted_at.begin(), accepted_at.end() - 1, accepted_at.end());
    accepted_at[0] = now;
    seen_at = stamp;
    tip_deviation = deviation;
  }
  void forgetTime() {
    accepted_at = farPast();
    arrived_at = accepted_at[0];
  }
  void forget() {
    accepted_at = farPast();
    tip_deviation = std::numeric_limits<double>::infinity();
  }
};

}  // namespace

struct VisualServo::Workspace {
  Workspace(const statics::ArmModel& given, const VisualServoConfig& given_config)
      : config((given_config.validate(), given_config)),
        arm(given.arm()),
        tracker(given, config.filter),
        watch(given, config.watchFilter()),
        budget(given, config.watchFilter(), config.placed),
        contact(given, config),
        on_contact(config.on_contact),
        estimated(given),
        observer(arm.actuatorCount(), config.time_constant, config.reading_noise),
        response(arm),
        aim(given, config.preference),
        usual_distance(Eigen::VectorXd::Zero(arm.actuatorCount())),
        divergence(config.smoothing + config.time_constant),
        swing(arm, config, !response.learns(), tracker.rows()),
        lengths(arm.actuatorCount()) {
    turn.pressure = arm.inputAt(0.0);
    turn.limits.assign(static_cast<std::size_t>(arm.actuatorCount()), statics::Limit::kNone);
    at_picture = moment = {turn.pressure, turn.pressure};
    commanded = turn.pressure;
    held_back = Eigen::VectorXd::Zero(arm.actuatorCount());
  }

  bool doubts() const { return contact.drift().doubtful; }
  bool yields() const { return on_contact != OnContact::kReport && contact.load().contact; }

  // Whether the estimate from pictures corrects the command.
  bool tracks(double now) const {
    if (!closed || yields() || diverged || doubts()) return false;
    return turn.state == LoopState::kClosed ||
           (turn.state == LoopState::kIdle && sight.suffices(now, config.stale_after));
  }

  void forgetContact() {
    contact.reset();
    watch.reset();
  }

  LoopState nextState(double now) const {
    if (!enabled || !target) return LoopState::kIdle;
    const double unseen = sight.unseen(now);
    const bool fresh = unseen <= config.stale_after;
    if (diverged && now - sight.arrived_at <= config.stale_after) return LoopState::kDiverging;
    if (yields() && fresh) return LoopState::kYielding;
    if (!closed) return LoopState::kOpen;
    const bool was_closed = turn.state == LoopState::kClosed || turn.state == LoopState::kDoubtful;
    if (!yields() && (sight.suffices(now, config.stale_after) || (was_closed && fresh))) {
      return doubts() ? LoopState::kDoubtful : LoopState::kClosed;
    }
    const bool coasts = was_closed || turn.state == LoopState::kCoasting ||
                        turn.state == LoopState::kDiverging ||
                        (turn.state == LoopState::kYielding && !fresh);
    return coasts && unseen <= config.coast_time ? LoopState::kCoasting : LoopState::kOpen;
  }

  // The path waits during a contact, or while the arm must not move.
  void moveWanted(double dt) {
    velocity.setZero();
    acceleration.setZero();
    turn.path_time.reset();
    learnt_goal.setZero();
    if (!path) return;
    const bool stands = turn.held || waits(dt);
    if (!stands) path_time += dt;
    turn.path_time = path_time;
    const auto at = [&](double time) {
      return time < 0 ? approach->at(time + approach->duration()) : path->at(time);
    };
    const control::TipReference reference = at(path_time);
    if (!stands) {
      velocity = reference.velocity;
      acceleration =
          (at(path_time + kAhead).velocity - at(path_time - kAhead).velocity) / (2 * kAhead);
      const double end = path->lastTime() - control::kShortestStep;
      if (path_time >= 0 && path_time < end) {
        const auto [dead_time, lag] = response.late();
        const double ahead = config.time_constant + dead_time + lag + kLearntTime;
        const control::TipReference later = at(std::min(path_time + ahead, end));
        learnt_goal = memory.at(later.position, later.velocity, reachAt(later.velocity));
      }
    }
    if (reference.rotation) {
      target = lie::SE3{*reference.rotation, reference.position};
    } else {
      target = reference.position;
    }
  }

  // Swings within half a period of the mode are not learnt.
  double reachAt(const Eigen::Vector3d& along) const {
    const double frequency = swing.mode() ? swing.mode()->frequency * pace : kSlowSwing;
    return std::max(kLeastReach, 0.5 * along.norm() / frequency);
  }

  // A path waits at its first point for an arm that a slow slew, a lag or a shaped step keeps from
  // it, but no longer than these last: not for a regulator that stays off its set point.
  bool waits(double dt) {
    if (path_time >= 0 || path_time + dt < 0) return false;
    const auto& mode = swing.mode();
    const double held = mode ? shareHeldBack(observer.time() - begun_at) : 0.0;
    const double behind = (response.effective() - commanded).cwiseAbs().maxCoeff() +
                          held * held_back.cwiseAbs().maxCoeff();
    if (waited == 0) {
      const auto [dead_time, lag] = response.late();
      longest_wait = behind / config.slew + kFaded * (config.time_constant + dead_time + lag) +
                     (mode ? 1 / (mode->frequency * pace) : 0.0);
    }
    if (behind <= kArrived || waited >= longest_wait) return false;
    waited += dt;
    return true;
  }

  void command(double dt) {
    const statics::InverseResult& result = solve(*target, false);
    turn.status = result.status;
    reaches = result.status == statics::InverseStatus::kReached;
    turn.residual = result.residual;
    turn.position_error = result.position_error;
    turn.limits = result.limits;
    commanded =
        aim.led({velocity, acceleration}, config.time_constant, response.late(), swing.mode());
    if (swing.mode()) commanded -= shareHeldBack(observer.time() - begun_at) * held_back;
    turn.pressure =
        response.pressureFor(commanded, dt, velocity.isZero() ? 0.0 : config.time_constant);
  }

  // Share held back of a step in three ramps, half a period of the mode apart, which leave it at
  // rest: the zero vibration and derivative shaper (Singer and Seering 1990).
  double shareHeldBack(double since) const {
    const estimation::Mode& mode = *swing.mode();
    const double root = std::sqrt(1 - mode.damping * mode.damping);
    const double half = 0.5 / (mode.frequency * pace * root);
    const double K = std::exp(-mode.damping * basics::kPi / root), all = (1 + K) * (1 + K);
    const auto waits = [&](double begin) {
      return std::clamp(1 - (since - begin) / ramp, 0.0, 1.0);
    };
    return (waits(0) + 2 * K * waits(half) + K * K * waits(2 * half)) / all;
  }

  std::optional<lie::SE3> tipAt(const Eigen::VectorXd& pressure) {
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      const model::Actuator& actuator = arm.actuator(i);
      lengths[i] = actuator.contraction.lengthInside(
          std::clamp(pressure[i], actuator.limits.lower, actuator.limits.upper));
    }
    const auto shape = estimated.shape(lengths);
    if (!shape) return std::nullopt;
    lie::SE3 tip = model::tipPose(*shape);
    tip.translation += contact.load().tip_beyond_fit;
    return tip;
  }

  // The wanted tip where the arm reaches it, else the predicted one; `unknown` if there is neither.
  lie::SE3 presentTip(const lie::SE3& unknown) {
    const auto predicted =
        observer.started() ? tipAt(response.effective()) : std::optional<lie::SE3>();
    lie::SE3 out = predicted.value_or(unknown);
    if (!target || (predicted && !reaches)) return out;
    if (!std::holds_alternative<Eigen::Vector3d>(*target)) return tipOf(*target, arm);
    out.translation = std::get<Eigen::Vector3d>(*target);
    return out;
  }

  void begin(const Target& next) {
    if (!target && observer.started()) aim.startAt(response.effective());
    reaches = within_reach = solve(next, true).status == statics::InverseStatus::kReached;
    target = next;
    held_back = aim.pressure() - commanded;
    ramp = std::max(held_back.cwiseAbs().maxCoeff() / config.slew, kShortestRamp);
    pace = estimation::paceOf(arm, arm.lengths(arm.clamped(aim.pressure())));
    if (observer.started()) begun_at = aimed_at = observer.time();
    divergence.clear();
    diverged = false;
    error.reset();
  }

  void learn() {
    aim.learn(tracker.correction());
    beyond_goal = contact.load().tip_beyond_fit;
    fades = false;
  }

  // The corrected model is brought where a load takes its tip to the wanted place.
  const statics::InverseResult& solve(const Target& wanted_tip, bool fresh) {
    response.limit(aim);
    const Eigen::Vector3d off = learnt - beyond;
    if (const auto* position = std::get_if<Eigen::Vector3d>(&wanted_tip)) {
      return aim.solve(Eigen::Vector3d(*position + off), fresh);
    }
    if (const auto* pose = std::get_if<lie::SE3>(&wanted_tip)) {
      return aim.solve(lie::SE3{pose->rotation, pose->translation + off}, fresh);
    }
    return aim.solve(wanted_tip, fresh);
  }

  void fade() {
    aim.learn(statics::Correction(arm));
    beyond_goal.setZero();
    fades = true;
  }

  // A regulator whose sensor is off, or whose supply is weak, is at rest away from its set point.
  void settle(double dt, const Eigen::VectorXd& set_point, const Eigen::VectorXd& reading) {
    const double share = -std::expm1(-dt / kUsualTime);
    settled = true;
    for (Eigen::Index i = 0; i < reading.size(); ++i) {
      const double distance = reading[i] - set_point[i], unusual = distance - usual_distance[i];
      settled &= std::min(std::abs(distance), std::abs(unusual)) < kSettledWithin;
      usual_distance[i] += share * unusual;
    }
  }

  estimation::ObservationFault findPressures(double stamp, double now) {
    using estimation::ObservationFault;
    if (!std::isfinite(stamp) || !std::isfinite(now)) return ObservationFault::kNotFinite;
    if (stamp > now) return ObservationFault::kFuture;
    if (observer.started() && stamp < observer.time() - kOldestPicture) {
      return ObservationFault::kTooOld;
    }
    const bool known = observer.at(stamp, at_picture) || observer.ahead(stamp, at_picture);
    if (!known) return ObservationFault::kTooOld;
    response.apply(stamp, at_picture);
    return ObservationFault::kNone;
  }

  // Advances the estimate of the arm's swing to a picture.
  void swingTo(double stamp) {
    swing.moveTo(stamp, [&](double time) -> const Eigen::VectorXd& {
      if (!observer.at(std::max(time, observer.earliest()), moment)) moment = observer.newest();
      if (!response.learns()) response.apply(time, moment);
      return moment.pressure;
    });
  }

  void learnMode(double stamp, const model::Twists& measured) {
    const bool swung = swing.mode().has_value();
    swing.learn(measured, tracker, contact.load().contact || doubts());
    response.learn(swing.response());
    // An onset from before the mode was known may be its swing.
    if (!swung && swing.mode() && !contact.load().contact) contact.reset();
    if (const auto& lagged = swing.response().begunAnew()) {
      if (!learnAgain()) response.restart(stamp, *lagged, observer);
    }
  }

  // Remembers a picture that the tracker has seen, while the observer has the pressures of all
  // since the first one.
  void remember(const estimation::ArmFilter::Input& picture) {
    if (!remembers) return;
    first_pictures.push_back(picture);
    remembers = first_pictures.front().time >= observer.earliest();
    if (!remembers) first_pictures.clear();
  }
  void forgetPictures() {
    first_pictures.clear();
    remembers = response.learns();
  }

  // With another lag, the first pictures show the arm at other pressures than those that the
  // tracker compared them with. The watch, which forgets by itself, keeps what it learnt: it would
  // change little. Returns false if the pictures are not remembered.
  bool learnAgain() {
    if (first_pictures.empty() || !observer.at(observer.earliest(), moment)) return false;
    response.restart(observer.earliest(), moment.pressure, observer);
    tracker.setState(before_pictures);
    tracker.forgetTime();
    const double doubt = swing.lagDoubt();
    Eigen::VectorXd rate = Eigen::VectorXd::Zero(arm.actuatorCount());
    const estimation::ArmFilter::Input* last = nullptr;
    for (estimation::ArmFilter::Input& picture : first_pictures) {
      if (!observer.at(picture.time, moment) && !observer.ahead(picture.time, moment)) continue;
      response.apply(picture.time, moment);
      picture.pressure = moment.pressure;
      if (last) rate = (picture.pressure - last->pressure) / (picture.time - last->time);
      picture.variance = moment.variance + (doubt * rate).cwiseAbs2();
      tracker.see(picture);
      last = &picture;
    }
    seen.pressure = first_pictures.back().pressure;
    return true;
  }

  // The measured tip with the wanted one at the time of the picture.
  void compare(double stamp, double now, const model::Twists& twists) {
    error.reset();
    const auto* const at = wanted.find(stamp);
    const auto shape = tracker.shape(seen.pressure);
    if (!at || !shape) return;
    const lie::SE3 tip = model::tipPose(shape->about(twists));
    const Eigen::Vector3d offset = tip.translation + contact.load().tip_beyond_fit - at->place;
    error = offset.norm();
    if (stamp <= aimed_at) return;  // says nothing of the present target
    if (path && path_time > kBefore && turn.state == LoopState::kClosed &&
        !contact.load().contact) {
      memory.add(stamp, at->place, at->velocity, reachAt(at->velocity), offset);
    }
    const bool corrected = turn.state == LoopState::kClosed && !path && within_reach;
    diverged |= divergence.add(now, offset, corrected);
  }

  const VisualServoConfig config;
  const model::Arm arm;
  estimation::ArmFilter tracker, watch;
  estimation::ErrorBudget budget;
  ContactWatch contact;
  OnContact on_contact;
  statics::CorrectedModel estimated;  // with everything the tracker has estimated
  control::PressureObserver observer;
  ResponseTracker response;
  Aim aim;  // at effective pressures

  bool settled = false;            // every pressure is where its regulator usually holds it
  Eigen::VectorXd usual_distance;  // of readings from set points, as long as it stays [Pa]
  bool enabled = false, closed = true, diverged = false;
  bool fades = false;  // the correction decays to 0
  // How far a load moves the tip beyond the model's: used, and where that goes, base frame [m].
  Eigen::Vector3d beyond = Eigen::Vector3d::Zero(), beyond_goal = Eigen::Vector3d::Zero();
  double touched_at = 0.0;                                       // the contact was found [s]
  double slow_until = -std::numeric_limits<double>::infinity();  // of the correction [s]

  std::optional<Target> target;
  std::optional<control::TipPath> path;
  std::optional<control::TipApproach> approach;  // of the path
  double path_time = 0.0;                        // negative during the approach [s]
  double waited = 0.0, longest_wait = 0.0;       // at its first point [s]
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero(), acceleration = velocity;

  Sight sight;
  TimeRing<Wanted, kMostTurns> wanted;
  PathMemory memory;
  // Where a path is aimed off it, and where that goes [m].
  Eigen::Vector3d learnt = Eigen::Vector3d::Zero(), learnt_goal = Eigen::Vector3d::Zero();
  DivergenceWatch divergence;
  double aimed_at = -std::numeric_limits<double>::infinity();  // at the target [s]
  bool reaches = false;       // the corrected model reaches the target
  bool within_reach = false;  // it did when the target was set
  std::optional<double> error;
  control::PressureObserver::Estimate at_picture;
  estimation::ArmFilter::Input seen;
  ArmSwing swing;
  // The first pictures of an arm whose lag is learnt, and what the tracker knew before them.
  std::vector<estimation::ArmFilter::Input> first_pictures;
  estimation::Gaussian before_pictures;
  bool remembers = response.learns();
  control::PressureObserver::Estimate moment;
  Eigen::VectorXd commanded;    // effective pressures of the last command (n) [Pa]
  Eigen::VectorXd held_back;    // of the last step (n) [Pa]
  double ramp = kShortestRamp;  // duration of each part of the step [s]
  double pace = 1.0;            // of the mode where the step leads
  double begun_at = 0.0;        // [s]
  Eigen::VectorXd lengths;
  Turn turn;
};

VisualServo::VisualServo(const statics::ArmModel& model, const VisualServoConfig& config)
    : work_(std::make_unique<Workspace>(model, config)) {}
VisualServo::~VisualServo() = default;
VisualServo::VisualServo(VisualServo&&) noexcept = default;
VisualServo& VisualServo::operator=(VisualServo&&) noexcept = default;

void VisualServo::aimAt(const Target& target) {
  work_->begin(target);
  work_->path.reset();
}

void VisualServo::follow(control::TipPath path) {
  Workspace& w = *work_;
  const control::TipReference first = path.at(0.0);
  const lie::SE3 to{first.rotation.value_or(Eigen::Matrix3d::Identity()), first.position};
  const lie::SE3 from = w.presentTip(to);
  w.approach = first.rotation ? control::TipApproach(from, to)
                              : control::TipApproach(from.translation, first.position);
  const bool there = w.approach->duration() <= kShortApproach;
  w.path_time = -(there ? control::kShortestStep : w.approach->duration());
  w.waited = 0.0;
  if (!w.target) w.begin(from.translation);
  w.divergence.clear();
  w.within_reach = true;  // of the path's last point, which then stays the target
  w.path = std::move(path);
}

void VisualServo::release() {
  work_->target.reset();
  work_->path.reset();
}

void VisualServo::hold() { work_->path.reset(); }

bool VisualServo::hasTarget() const { return work_->target.has_value(); }

void VisualServo::enable(bool enabled) {
  Workspace& w = *work_;
  if (w.enabled && !enabled) {
    release();
    // An obstacle that held the arm says nothing of it once vented: the watch, which knew it,
    // begins anew.
    if (w.contact.load().contact) w.forgetContact();
  }
  w.enabled = enabled;
}

void VisualServo::close(bool closed) {
  Workspace& w = *work_;
  if (w.closed && !closed) w.fade();
  w.closed = closed;
}

void VisualServo::reset() {
  Workspace& w = *work_;
  w.tracker.reset();
  w.budget.reset();
  w.forgetContact();
  w.swing.reset();
  w.forgetPictures();
  w.memory.clear();
  w.response.learn(w.swing.response());
  w.estimated.set(w.tracker.correction());
  w.sight.forget();
  w.diverged = false;
  w.divergence.clear();
  if (w.observer.started()) w.slow_until = w.observer.time() + 1.0;
  w.fade();
}

void VisualServo::setOnContact(OnContact reaction) { work_->on_contact = reaction; }
void VisualServo::ignoreContacts(bool ignores) { work_->contact.onsets().ignoreContacts(ignores); }
void VisualServo::distrustModel(bool distrusts) {
  if (work_->contact.distrust(distrusts) && distrusts) work_->forgetContact();
}
double VisualServo::contactLimit() const { return work_->config.contact.limit; }

const Turn& VisualServo::reading(double time, const Eigen::VectorXd& set_point,
                                 const Eigen::VectorXd& reading) {
  Workspace& w = *work_;
  const bool began = w.observer.started();
  double dt = began ? time - w.observer.time() : 0.0;
  if (dt < 0) {  // the clock was set back: the estimate of the arm stays
    w.tracker.forgetTime();
    w.watch.forgetTime();
    w.wanted.clear();
    w.forgetPictures();
    w.memory.clear();
    w.divergence.clear();
    w.sight.forgetTime();
    w.aimed_at = w.slow_until = w.begun_at = -std::numeric_limits<double>::infinity();
    w.touched_at = time;
  }
  dt = std::clamp(dt, 0.0, kLongestTurn);
  w.observer.update(time, set_point, reading);
  w.settle(dt, set_point, reading);
  w.response.follow(w.observer);

  const bool waited =
      time - w.touched_at > w.config.yield_timeout && w.sight.unseen(time) <= w.config.stale_after;
  if (waited && w.contact.load().contact && w.on_contact == OnContact::kYield) w.forgetContact();
  const LoopState before = w.turn.state;
  w.turn.state = w.nextState(time);
  w.turn.held = w.yields();
  if (w.turn.state == LoopState::kClosed && before != LoopState::kClosed) w.learn();
  if (w.tracks(time) || w.fades) {
    const bool slow = !w.closed || time < w.slow_until;
    const double share = -std::expm1(-dt / (slow ? kFadeTime : w.swing.smoothing()));
    w.aim.approach(share);
    w.beyond += share * (w.beyond_goal - w.beyond);
  }
  w.turn.commands = w.turn.state != LoopState::kIdle;
  if (w.turn.commands) {
    w.moveWanted(dt);
    w.learnt -= std::expm1(-dt / kLearntTime) * (w.learnt_goal - w.learnt);
    w.command(dt);
    w.turn.wanted = tipOf(*w.target, w.arm);
    w.wanted.add(time, {w.turn.wanted.translation, w.velocity});
  } else if (w.observer.started()) {
    w.response.release();
    w.aim.startAt(w.response.effective());
    w.commanded = w.aim.pressure();
  }
  w.turn.predicted = w.observer.started() ? w.tipAt(w.response.effective()) : std::nullopt;
  return w.turn;
}

estimation::Observation VisualServo::picture(double stamp, double now, const model::Twists& twists,
                                             const Eigen::MatrixXd& covariance,
                                             const std::optional<std::vector<int>>& tags) {
  Workspace& w = *work_;
  estimation::Observation out;
  out.fault = w.findPressures(stamp, now);
  if (!out.accepted()) return out;
  w.sight.arrived_at = now;
  w.swingTo(stamp);
  const estimation::ArmFilter::Input input{stamp, w.at_picture.pressure, w.at_picture.variance,
                                           w.swing.atRest(twists, w.tracker),
                                           covariance + w.swing.noise(kSwingError, w.tracker)};
  const bool touched = w.contact.load().contact;
  w.contact.see(input, tags, w.settled, w.swing.peak(w.tracker), w.swing.possible(w.tracker),
                w.watch);
  if (!touched && w.contact.load().contact) {
    w.touched_at = now;
    if (w.on_contact == OnContact::kStop) hold();
  }
  // The watch has none of the lag's noise, in which a camera that slips would hide.
  w.seen = input;
  w.seen.covariance += w.swing.lagNoise(w.tracker);
  if (w.remembers && w.first_pictures.empty()) w.before_pictures = w.tracker.state();
  out = w.tracker.see(w.seen);
  if (!out.accepted()) return out;
  w.remember(input);
  w.learnMode(stamp, twists);
  if (!w.contact.load().contact || w.doubts()) {
    w.budget.update(w.watch, input, tags, w.doubts());
  }
  w.estimated.set(w.tracker.correction());
  const Eigen::Matrix3d tip_covariance = estimation::tipCovariance(
      model::shapeOf(w.arm, twists), w.tracker.twistCovariance(now - stamp));
  w.sight.accept(now, stamp, largestDeviation(tip_covariance));
  if (w.tracks(now)) w.learn();
  w.compare(stamp, now, twists);
  return out;
}

const estimation::ArmFilter::Input& VisualServo::seen() const { return work_->seen; }

std::optional<Prediction> VisualServo::prediction() const {
  const Workspace& w = *work_;
  if (!w.observer.started()) return std::nullopt;
  control::PressureObserver::Estimate at = w.observer.newest();
  w.response.apply(w.observer.time(), at);
  auto shape = w.tracker.shape(at.pressure);
  if (!shape) return std::nullopt;
  // The creep of the tracker serves the control: no arm creeps as fast. During a contact the watch
  // knows the arm without the force.
  const estimation::ArmFilter& filter = w.contact.load().contact ? w.tracker : w.watch;
  Eigen::MatrixXd covariance =
      filter.twistCovariance(std::max(0.0, w.observer.time() - w.sight.seen_at));
  covariance += w.swing.noise(kSwingSpread, w.tracker);
  if (const auto& step = filter.lastStep()) {
    const Eigen::MatrixXd& H_p = step->model.by_pressure;
    const Eigen::VectorXd variance = at.variance + filter.changeVariance(at.pressure);
    covariance(filter.rows(), filter.rows()) += H_p * variance.asDiagonal() * H_p.transpose();
  }
  const Eigen::Matrix3d tip = estimation::tipCovariance(*shape, covariance);
  return Prediction{std::move(*shape), std::move(covariance), tip};
}

LoopState VisualServo::state() const { return work_->turn.state; }
const Turn& VisualServo::turn() const { return work_->turn; }
const control::PressureObserver& VisualServo::observer() const { return work_->observer; }
const estimation::ArmFilter& VisualServo::tracker() const { return work_->tracker; }
const estimation::ArmFilter& VisualServo::watch() const { return work_->watch; }
const std::optional<estimation::Mode>& VisualServo::mode() const { return work_->swing.mode(); }
const estimation::ResponseEstimator& VisualServo::response() const {
  return work_->swing.response();
}
const std::optional<estimation::TipErrorBudget>& VisualServo::budget() const {
  return work_->budget.current();
}
bool VisualServo::sees() const {
  return work_->observer.started() &&
         work_->sight.unseen(work_->observer.time()) <= work_->config.coast_time;
}
const estimation::ExternalLoad& VisualServo::load() const { return work_->contact.load(); }
const estimation::QuietScore& VisualServo::quiet() const { return work_->contact.onsets().quiet(); }
const estimation::Drift& VisualServo::drift() const { return work_->contact.drift(); }
std::optional<double> VisualServo::error() const { return work_->error; }
double VisualServo::tipDeviation() const { return work_->sight.tip_deviation; }

}  // namespace helix_arm::follow
