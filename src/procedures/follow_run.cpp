#include "follow_run.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <set>
#include <stdexcept>
#include <utility>
#include <variant>
#include <vector>

#include "commissioning.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/clearance/sweep.hpp"
#include "helix_arm/control/safety.hpp"
#include "suspect_watch.hpp"

namespace helix_arm::procedures {

namespace {

constexpr double kSettledWithin = 0.002;  // [m]
constexpr double kSettledPart = 0.05;     // of the step

double errorOf(const FollowRow& row) { return (row.true_tip - *row.wanted).norm(); }

using Rows = std::vector<FollowRow>::const_iterator;

double rms(Rows begin, Rows end) {
  double sum = 0.0;
  for (Rows row = begin; row != end; ++row) sum += errorOf(*row) * errorOf(*row);
  return std::sqrt(sum / static_cast<double>(end - begin));
}

// Time from the first row until the error stays within the bound; absent if it never does.
std::optional<double> settleTime(Rows begin, Rows end) {
  const double step = errorOf(*begin);
  const double bound = kSettledWithin + kSettledPart * step;
  Rows last_outside = end;
  for (Rows row = begin; row != end; ++row) {
    if (errorOf(*row) > bound) last_outside = row;
  }
  if (last_outside == end) return 0.0;
  if (last_outside + 1 == end) return std::nullopt;
  return (last_outside + 1)->time - begin->time;
}

// @param tips  number of tips that share the rows' time evenly.
FollowFigures tipFigures(const std::vector<FollowRow>& rows, int tips) {
  FollowFigures out;
  const auto count = static_cast<std::ptrdiff_t>(rows.size());
  for (int k = 0; k < tips; ++k) {
    const Rows begin = rows.begin() + count * k / tips, end = rows.begin() + count * (k + 1) / tips;
    out.settle.push_back(settleTime(begin, end));
    const double from = (end - 1)->time - kLeastTipTime;
    const Rows steady =
        std::find_if(begin, end, [from](const FollowRow& row) { return row.time >= from; });
    out.steady_rms.push_back(rms(steady, end));
    out.unreachable.push_back((end - 1)->unreachable);
    out.limits.push_back((end - 1)->limits);
  }
  return out;
}

constexpr double kTurn = 0.01;           // [s]
constexpr double kProgressPeriod = 1.0;  // [s]
constexpr double kClosed = 1e-6;         // largest distance of a closed path's ends [m]
// Parts of a closed path's extent: beyond the first it has left its end, within the second it
// passes.
constexpr double kLeft = 0.25, kPasses = 0.02;

// When a closed path last passed its end before; its begin if it has one turn; absent if it is
// open.
std::optional<double> lastTurnOf(const control::TipPath& path) {
  const double begin = path.firstTime(), end = path.lastTime();
  const Eigen::Vector3d goal = path.at(end).position;
  const auto distance = [&](double time) { return (path.at(time).position - goal).norm(); };
  if (distance(begin) > kClosed) return std::nullopt;
  double extent = 0.0;
  for (double time = begin; time < end; time += kTurn) extent = std::max(extent, distance(time));
  bool left = false;
  for (double time = end; time > begin + kTurn; time -= kTurn) {
    const double here = distance(time);
    left |= here > kLeft * extent;
    if (left && here <= kPasses * extent && here <= distance(time - kTurn)) return time;
  }
  return begin;
}

FollowFigures pathFigures(const std::vector<FollowRow>& rows, const control::TipPath& path) {
  FollowFigures out;
  const auto isFrom = [](double time) {
    return [time](const FollowRow& row) { return row.path_time && *row.path_time >= time; };
  };
  const Rows begin = std::find_if(rows.begin(), rows.end(), isFrom(0.0));
  const Rows end = std::find_if(begin, rows.end(), [&path](const FollowRow& row) {
    return !row.path_time || *row.path_time > path.lastTime();
  });
  if (begin == end) return out;
  out.path_rms = rms(begin, end);
  out.path_max = 0.0;
  for (Rows row = begin; row != end; ++row) out.path_max = std::max(*out.path_max, errorOf(*row));
  const auto last_turn = lastTurnOf(path);
  const Rows turn = last_turn ? std::find_if(begin, end, isFrom(*last_turn)) : end;
  const bool ran = end != rows.end() || *rows.back().path_time >= path.lastTime() - kTurn;
  if (turn != end && ran) out.last_turn_rms = rms(turn, end);
  return out;
}

constexpr double kPictureRate = 30;  // [Hz]
constexpr double kRounding = 1e-9;   // of times [s]
constexpr int kMostReadings = 100;   // until the arm may be enabled

// For a scene without a simulated regulator: one as the loop expects it.
regulator::SimulatedRegulatorConfig simulatedConfigOf(const io::Scene& scene, std::uint32_t seed) {
  regulator::SimulatedRegulatorConfig out = simulatedRegulatorOf(scene);
  if (!scene.regulator ||
      !std::holds_alternative<regulator::SimulatedRegulatorConfig>(*scene.regulator)) {
    out.time_constant = scene.follow.time_constant;
    out.noise = scene.follow.reading_noise;
  }
  out.seed = seed;
  return out;
}

void requireVision(const io::Scene& scene) {
  basics::require(scene.isSeen(), "scene ", scene.name,
                  " has neither `camera` and `tags` nor `bodies`; the closed loop needs them");
}

// The rig has the arm of the scene, its tags in their order.
void requireRigOf(const io::Scene& scene, const io::Scene& rig) {
  const auto partsOf = [](const io::Scene& one) {
    std::vector<int> out(1, one.arm.sectionCount());
    for (int k = 0; k <= out[0]; ++k) out.push_back(one.arm.firstActuator(k));
    for (const estimation::TagPlacement& tag : one.tags->tags) out.push_back(tag.id);
    return out;
  };
  basics::require(partsOf(rig) == partsOf(scene), "the rig of scene ", rig.name,
                  " has other sections, actuators or tags than ", scene.name,
                  "; give the scene that this one was calibrated from");
}

void requireSound(const FollowPlan& plan) {
  basics::requirePositive("follow", "the duration [s]", plan.seconds);
  basics::require(plan.path.has_value() != !plan.tips.empty(),
                  "follow: expected either tips or a path");
  const double least = kLeastTipTime * static_cast<double>(plan.tips.size());
  basics::requireValue(plan.seconds >= least, "follow", "the duration [s]", plan.seconds,
                       "at least 1 s for each tip");
  if (plan.drift) {
    basics::requirePositive("follow", "the duration of the camera's drift [s]",
                            plan.drift->seconds);
  }
  if (plan.force) {
    basics::requireValue(std::isfinite(plan.force->time), "follow", "the time of the force [s]",
                         plan.force->time, "a finite value");
  }
}

// A plan on its rig: the rig, its safety core and a visual servo in one thread and in a fixed
// order, with a simulated time. The same seeds give the same figures on any machine under any load.
class FollowRun {
 public:
  // The arm starts enabled, vented and at rest.
  // @throws std::runtime_error if the safety core refuses to be enabled.
  FollowRun(const io::Scene& scene, const io::Scene& rig, const FollowPlan& plan)
      : scene_(scene),
        plan_(plan),
        rate_(rig.hasBodies() ? std::min(rig.simulation.bodies.rate, 1 / kTurn) : kPictureRate),
        turns_(static_cast<std::int64_t>(std::llround(plan.seconds / kTurn))),
        seen_rig_(seenRigOf(scene, rig, plan.plant, plan.vision, plan.seed)),
        core_(scene.safety.channels, scene.safety.rules),
        loop_(scene.model, loopConfigOf(scene)),
        suspects_(scene) {
    basics::requireNotNegative("lockstep", "the latency [s]", plan.latency);
    std::string refusal = "the regulator was not read";
    // With noise, single readings may look like pressure.
    for (int k = 0; k < kMostReadings && !refusal.empty(); ++k) {
      readPressures(0.0);
      core_.advance(0.0);
      refusal = core_.enable(0.0);
    }
    if (!refusal.empty()) throw std::runtime_error("lockstep: " + refusal);
    loop_.enable(true);
    loop_.reading(0.0, core_.orders().set_point, reading_);
    if (plan.open) loop_.close(false);
    loop_.ignoreContacts(plan.ignore_contacts);
    if (plan.path) loop_.follow(*plan.path);
  }

  FollowResult take(const std::function<bool(double)>& progress) {
    run(progress);
    out_.suspects = suspects_.suspects();
    if (out_.moved) out_.suspects.insert(out_.suspects.begin(), suspectOf(out_.moved->base));
    return std::move(out_);
  }

 private:
  struct Waiting {
    double stamp, due;
    simulation::MeasuredShape shape;
  };

  double time() const { return static_cast<double>(steps_) * kTurn; }  // [s]

  void run(const std::function<bool(double)>& progress) {
    double told = 0.0;
    while (steps_ < turns_) {
      aim(steps_);
      disturb();
      advance();
      record();
      if (core_.state() != control::SafetyState::kEnabled) {
        out_.vented = core_.reason();
        return;
      }
      if (progress && (!plan_.plant.empty() || time() >= told + kProgressPeriod)) {
        told = time();
        if (!progress(told)) return;
      }
      const std::optional<double>& path_time = out_.rows.back().path_time;
      if (plan_.to_path_end && path_time && *path_time > plan_.path->lastTime()) break;
    }
    out_.budget = loop_.budget();
    if (out_.pictures == 0) out_.why_unseen = why_unseen_;
    out_.quiet = loop_.quiet();
    out_.uncalibrated_tags = uncalibratedTags(*scene_.tags, {fitted_.begin(), fitted_.end()});
    out_.lag = loop_.response().lag();
    out_.play = loop_.response().play();
    out_.figures = plan_.path ? pathFigures(out_.rows, *plan_.path)
                              : tipFigures(out_.rows, static_cast<int>(plan_.tips.size()));
  }

  void readPressures(double now) {
    reading_ = seen_rig_.rig.measure();
    core_.measured(now, reading_);
  }

  // One turn: the regulator follows the last orders, is read, the loop turns, its command goes
  // through the safety core, and pictures whose time has come arrive.
  // Throws as SimulatedRig::shape() does.
  void advance() {
    ++steps_;
    const double now = time();
    const Eigen::VectorXd set_point = core_.orders().set_point;
    seen_rig_.rig.command(set_point);
    seen_rig_.rig.step(kTurn);
    readPressures(now);
    loop_.enable(core_.state() == control::SafetyState::kEnabled);
    const follow::Turn& turn = loop_.reading(now, set_point, reading_);
    if (turn.commands) core_.target(now, turn.pressure);
    core_.advance(now);
    if (now + kRounding >= static_cast<double>(pictures_ + 1) / rate_) {
      ++pictures_;
      takePicture(now);
    }
    deliver(now);
  }

  void takePicture(double now) {
    if (plan_.blind && plan_.blind->contains(now)) {
      why_unseen_ = "the picture is lost, as in the interval without pictures";
      return;
    }
    const Eigen::VectorXd pressure = scene_.model.arm().clamped(reading_);
    const model::Shape nominal =
        statics::startingShape(scene_.model, scene_.model.solve(pressure), pressure);
    // A tip is measured and predicted with the same deviations from the mean twists.
    const auto corrected = loop_.tracker().shape(pressure);
    const model::Shape expected = corrected ? corrected->about(nominal.twists()) : nominal;
    if (auto seen = seen_rig_.vision.look(seen_rig_.rig.shape(), expected)) {
      waiting_.push_back({now, now + plan_.latency, std::move(*seen)});
    } else {
      why_unseen_ = seen_rig_.vision.whyUnseen();
    }
  }

  void deliver(double now) {
    while (!waiting_.empty() && waiting_.front().due <= now + kRounding) {
      const Waiting& next = waiting_.front();
      const auto observation =
          loop_.picture(next.stamp, now, next.shape.twists, next.shape.covariance, next.shape.tags);
      suspects_.see(loop_, observation, true);
      if (observation.accepted()) {
        ++out_.pictures;
      } else {
        why_unseen_ = std::string("the picture is refused: ") + nameOf(observation.fault);
      }
      fitted_.insert(next.shape.tags.begin(), next.shape.tags.end());
      measured_ = next.shape.tip;
      stamp_ = next.stamp;
      waiting_.pop_front();
    }
  }

  void aim(std::int64_t turn) {
    const auto tips = static_cast<std::int64_t>(plan_.tips.size());
    if (tips > 0 && (turn == 0 || turn * tips / turns_ != (turn - 1) * tips / turns_)) {
      loop_.aimAt(plan_.tips[static_cast<std::size_t>(turn * tips / turns_)]);
    }
  }

  void disturb() {
    if (plan_.force && !pulled_ && time() >= plan_.force->time) {
      seen_rig_.rig.setTipForce(plan_.force->force);
      pulled_ = true;
    }
    if (plan_.drift) {
      const double part = (time() - plan_.drift->begin) / plan_.drift->seconds;
      seen_rig_.vision.shift(std::clamp(part, 0.0, 1.0) * plan_.drift->pixels);
    }
    if (plan_.frozen) seen_rig_.vision.freeze(plan_.frozen->contains(time()));
  }

  void record() {
    const estimation::ExternalLoad& load = loop_.load();
    if (load.contact) {
      if (!touched_) {
        out_.alarms.push_back({time(), load.onset, load.force, load.covariance, load.normalised});
      }
      out_.alarms.back().force = load.force;
      out_.alarms.back().covariance = load.covariance;
    }
    touched_ = load.contact;
    if (!suspects_.suspects().empty()) out_.alarms.clear();
    if (load.blind) out_.contact_blind += kTurn;
    const follow::Turn& turn = loop_.turn();
    addRow(turn, load.score);
    if (out_.states.empty() || out_.states.back().state != turn.state) {
      out_.states.push_back({time(), turn.state});
    }
    const auto& moved = seen_rig_.vision.moved();
    if (moved && !out_.moved) out_.moved = {time(), *moved};
  }

  void addRow(const follow::Turn& turn, double load_score) {
    FollowRow row;
    row.time = time();
    if (turn.commands) row.wanted = turn.wanted.translation;
    row.true_tip = model::tipPose(seen_rig_.rig.shape()).translation;
    if (stamp_ > last_stamp_) {
      row.measured = measured_.translation;
      row.measured_time = last_stamp_ = stamp_;
      if (const auto prediction = loop_.prediction()) {
        row.predicted_covariance = prediction->tip_covariance;
      }
    }
    if (turn.predicted) row.predicted = turn.predicted->translation;
    row.pressure = seen_rig_.rig.pressure();
    row.state = turn.state;
    row.path_time = turn.path_time;
    row.unreachable = turn.commands && turn.status == statics::InverseStatus::kUnreachable;
    if (turn.commands) row.limits = turn.limits;
    row.load_score = load_score;
    out_.rows.push_back(std::move(row));
  }

  const io::Scene& scene_;
  const FollowPlan& plan_;
  const double rate_;  // of the pictures [Hz]
  const std::int64_t turns_;
  SeenRig seen_rig_;
  control::SafetyCore core_;
  follow::VisualServo loop_;
  SuspectWatch suspects_;
  std::int64_t steps_ = 0, pictures_ = 0;
  Eigen::VectorXd reading_;
  std::deque<Waiting> waiting_;
  lie::SE3 measured_;                        // last measured tip
  double stamp_ = -1.0, last_stamp_ = -1.0;  // of its picture, and of that in the last row [s]
  std::set<int> fitted_;                     // indices of the tags in those pictures
  std::string why_unseen_ = "no picture arrived in the time";  // of the last that was not accepted
  FollowResult out_;
  bool pulled_ = false, touched_ = false;
};

}  // namespace

void endWithPath(FollowPlan& plan) {
  constexpr double kLongestApproach = 60;  // [s]
  plan.to_path_end = true;
  plan.seconds = plan.path->lastTime() + kLongestApproach;
}

std::string failureOf(const FollowPlan& plan, const FollowResult& result) {
  if (!result.vented.empty()) return "the arm was vented: " + result.vented;
  if (plan.path && !result.figures.path_rms) {
    return "the time ended before the tip had reached the path's first point; raise --seconds";
  }
  if (!plan.open && !result.why_unseen.empty()) {
    return "the arm was never seen, so the loop did not close: " + result.why_unseen +
           "; check camera and tags by helix_arm check, or give --open";
  }
  return {};
}

std::optional<follow::PathRefusal> checkPath(const io::Scene& scene, const control::TipPath& path) {
  statics::InverseOptions options;
  options.preference = scene.follow.preference;
  statics::InverseSolver solver(scene.model, options);
  follow::PathRules rules;
  const auto& channels = scene.safety.channels;
  rules.slew.resize(static_cast<Eigen::Index>(channels.size()));
  std::transform(channels.begin(), channels.end(), rules.slew.begin(),
                 [](const control::ChannelRules& channel) { return channel.slew; });
  std::optional<clearance::SweepCheck> zones;
  if (scene.keep_out) rules.zones = &zones.emplace(scene.model, *scene.keep_out);
  return follow::checkPath(path, scene.arm, solver, scene.arm.inputAt(0.0), rules);
}

SeenRig seenRigOf(const io::Scene& scene, const io::Scene& rig, const std::string& plant,
                  simulation::VisionKind kind, std::uint32_t seed) {
  requireVision(scene);
  requireVision(rig);
  requireRigOf(scene, rig);
  auto camera = rig.cameraSetup();
  camera->config.seed = seed;
  const simulation::SimulatedVisionConfig vision{kind, 0.3, seed};
  simulation::SimulatedRig true_rig(rig.model, simulatedConfigOf(rig, seed), rig.simulation.arm);
  if (!plant.empty()) {
    true_rig.takeArm(std::make_unique<simulation::Plant>(plant, rig.arm, rig.tags->tags));
  }
  return {std::move(true_rig),
          simulation::SimulatedVision(*camera, scene.view(), localizerConfigOf(scene), vision)};
}

FollowResult runFollow(const io::Scene& scene, const FollowPlan& plan,
                       const std::function<bool(double)>& progress) {
  return runFollow(scene, scene, plan, progress);
}

FollowResult runFollow(const io::Scene& scene, const io::Scene& rig, const FollowPlan& plan,
                       const std::function<bool(double)>& progress) {
  requireSound(plan);
  return FollowRun(scene, rig, plan).take(progress);
}

}  // namespace helix_arm::procedures
