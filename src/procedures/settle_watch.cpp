#include "settle_watch.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "basics/median.hpp"
#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/control/target_check.hpp"
#include "helix_arm/model/arm_response.hpp"

namespace helix_arm::procedures {

namespace {

// All coordinates of a tag or body.
Eigen::Map<const Eigen::ArrayXd> coordinatesOf(const TagObservation& one) {
  if (one.points) return {one.points->data(), one.points->size()};
  return {one.corners.data(), one.corners.size()};
}
Eigen::Map<Eigen::ArrayXd> coordinatesOf(TagObservation& one) {
  if (one.points) return {one.points->data(), one.points->size()};
  return {one.corners.data(), one.corners.size()};
}

// Fraction of the tags that must be still; a few may be misread.
constexpr double kStillShare = 0.75;

// Motion of the tags between two pictures: the distance that kStillShare of the common tags stay
// below [px, of bodies m]; absent without common tags.
std::optional<double> distanceBetween(const std::vector<TagObservation>& a,
                                      const std::vector<TagObservation>& b) {
  std::vector<double> moved;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (i->id < j->id) {
      ++i;
    } else if (j->id < i->id) {
      ++j;
    } else {
      const auto change = coordinatesOf(*i++) - coordinatesOf(*j++);
      moved.push_back(std::sqrt(change.square().sum() / 4));
    }
  }
  if (moved.empty()) return std::nullopt;
  const auto rank =
      static_cast<std::ptrdiff_t>(std::ceil(kStillShare * static_cast<double>(moved.size()))) - 1;
  std::nth_element(moved.begin(), moved.begin() + rank, moved.end());
  return moved[static_cast<std::size_t>(rank)];
}

// Why what came last at `last` is too old; empty if it is not.
std::string staleness(std::optional<double> last, double now, double max_age, const char* what,
                      const char* remedy) {
  if (!last) return basics::format("%s: none received yet; %s", what, remedy);
  const double age = now - *last;
  if (age < -max_age) {
    return basics::format(
        "%s: the last are stamped %.2f s ahead of now (at most %g s); synchronise the clocks", what,
        -age, max_age);
  }
  if (age <= max_age) return "";
  // Stamps tell when something was measured, not when it came.
  return basics::format("%s: the last are stamped %.2f s before now (at most %g s); %s If so, %s",
                        what, age, max_age, remedy, control::whyLate(age));
}

}  // namespace

TagObservation TagObservation::ofBody(int id, const lie::SE3& X_FM) {
  TagObservation out{id, Eigen::Matrix<double, 2, 4>::Zero()};
  out.points.emplace();
  *out.points << X_FM.translation, (kAxis * X_FM.rotation).colwise() + X_FM.translation;
  return out;
}

lie::SE3 TagObservation::X_FM() const {
  const Eigen::Vector3d origin = points->col(0);
  const Eigen::Matrix3d axes = (points->rightCols<3>().colwise() - origin) / kAxis;
  return {Eigen::Quaterniond(axes).normalized().toRotationMatrix(), origin};
}

Sample medianOf(const std::vector<Sample>& samples) {
  basics::require(!samples.empty(), "a median of no samples; expected at least one");
  Sample out{samples.back().time, samples.back().pressure, {}};
  std::map<int, std::vector<const TagObservation*>> observations;
  for (const Sample& sample : samples) {
    basics::require(sample.pressure.size() == out.pressure.size(), "samples of ",
                    sample.pressure.size(), " and of ", out.pressure.size(),
                    " pressures; expected those of one arm");
    out.time = std::max(out.time, sample.time);
    for (const TagObservation& tag : sample.tags) observations[tag.id].push_back(&tag);
  }
  std::vector<double> values;
  const auto median = [&values](const auto& entries, const auto& valueOf) {
    values.clear();
    for (const auto& entry : entries) values.push_back(valueOf(entry));
    return basics::medianOf(values);
  };
  for (Eigen::Index i = 0; i < out.pressure.size(); ++i) {
    out.pressure[i] = median(samples, [i](const Sample& s) { return s.pressure[i]; });
  }
  for (const auto& [id, seen] : observations) {
    if (2 * seen.size() < samples.size()) continue;
    TagObservation& tag = out.tags.emplace_back(*seen.front());
    auto coordinates = coordinatesOf(tag);
    for (Eigen::Index k = 0; k < coordinates.size(); ++k) {
      coordinates[k] = median(seen, [k](const TagObservation* s) { return coordinatesOf(*s)[k]; });
    }
  }
  return out;
}

void SettleRules::validate() const {
  basics::requirePositive("the settle rules", {{"pressure_tolerance", pressure_tolerance},
                                               {"corner_tolerance", corner_tolerance},
                                               {"body_tolerance", body_tolerance},
                                               {"window", window},
                                               {"max_age", max_age}});
}

SettleWatch::SettleWatch(std::vector<std::string> names, const SettleRules& rules)
    : names_(std::move(names)), rules_(rules) {
  basics::require(!names_.empty(), "a watch over no actuators; expected at least one");
  rules_.validate();
}

SettleWatch::SettleWatch(const model::Arm& arm, const SettleRules& rules)
    : SettleWatch(arm.actuatorNames(), rules) {
  waitForRest(arm);
}

void SettleWatch::waitForRest(const model::Arm& arm) {
  rest_time_ = model::ArmResponse(arm).restTime();
}

void SettleWatch::checkSize(const Eigen::VectorXd& pressure) const {
  basics::require(pressure.size() == static_cast<Eigen::Index>(names_.size()), pressure.size(),
                  " pressures for ", names_.size(), " actuators; expected one each");
}

template <class Entry>
void SettleWatch::add(std::deque<Entry>& history, Entry entry) const {
  if (!history.empty()) {
    const double step = entry.time - history.back().time;
    if (step == 0) history.pop_back();  // the clock does not advance
    if (step < 0 || step > rules_.max_age) history.clear();
  }
  history.push_back(std::move(entry));
}

void SettleWatch::command(double time, const Eigen::VectorXd& set_point) {
  checkSize(set_point);
  const bool broken = time < set_last_ || time - set_last_ > rules_.max_age;
  if (!set_point_ || broken || *set_point_ != set_point) set_since_ = time;
  set_point_ = set_point;
  set_last_ = time;
}

void SettleWatch::measured(double time, const Eigen::VectorXd& pressure) {
  checkSize(pressure);
  add(readings_, Reading{time, pressure});
  // Pictures arrive later than pressures, so the history that they may need is kept.
  const double oldest = time - readingTime() - rules_.max_age;
  while (readings_.size() > 1 && readings_[1].time <= oldest) readings_.pop_front();
}

void SettleWatch::seen(double time, std::vector<TagObservation> tags) {
  add(observations_, Observation{time, std::move(tags)});
  while (observations_.size() > 1 && observations_[1].time <= windowBegin())
    observations_.pop_front();
}

std::string SettleWatch::pressureStaleness(double now) const {
  std::string out =
      staleness(readings_.empty() ? std::nullopt : std::optional(readings_.back().time), now,
                rules_.max_age, "measured pressures", "is the regulator's node running?");
  if (out.empty() && set_point_) {
    out = staleness(set_last_, now, rules_.max_age, "commanded pressures",
                    "is pressure_command running?");
  }
  return out;
}

std::string SettleWatch::pictureStaleness(double now) const {
  return staleness(observations_.empty() ? std::nullopt : std::optional(observations_.back().time),
                   now, rules_.max_age, "tag detections",
                   "are camera (or motion capture) and vision running?");
}

std::string SettleWatch::pressureFault(Eigen::VectorXd& mean) const {
  const double end = observations_.back().time, begin = end - readingTime();
  if (set_point_ && set_since_ > end - holdTime()) {
    return basics::format("the set point has held for %.2f s of the tags' time; expected %g s",
                          std::max(0.0, end - set_since_), holdTime());
  }
  if (readings_.front().time > begin) {
    return basics::format("pressures were measured for %.2f s; expected %g s",
                          readings_.back().time - readings_.front().time, readingTime());
  }
  // Mean over each half: noise averages out, a drift does not.
  const double middle = 0.5 * (begin + end);
  const auto size = static_cast<Eigen::Index>(names_.size());
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(size, 2);
  Eigen::Array2d counts = Eigen::Array2d::Zero();
  for (const Reading& reading : readings_) {
    if (reading.time < begin || reading.time > end) continue;
    const int half = reading.time < middle ? 0 : 1;
    sums.col(half) += reading.pressure;
    counts[half] += 1;
  }
  if ((counts == 0).any()) return "too few pressures were measured before the picture came";
  mean = sums.rowwise().sum() / counts.sum();
  const Eigen::VectorXd wanted = set_point_.value_or(mean);
  for (int half = 0; half < 2; ++half) {
    for (Eigen::Index i = 0; i < size; ++i) {
      const double off = sums(i, half) / counts[half] - wanted[i];
      // Not <=: a NaN is not settled.
      if (std::abs(off) <= rules_.pressure_tolerance) continue;
      return basics::format("%s is %.2f kPa from %s; expected at most %g kPa",
                            names_[static_cast<std::size_t>(i)].c_str(), 1e-3 * off,
                            set_point_ ? "its set point" : "its mean",
                            1e-3 * rules_.pressure_tolerance);
    }
  }
  return "";
}

std::string SettleWatch::motion(double begin) const {
  if (observations_.front().time > begin) {
    return basics::format("the tags were watched for %.2f s; expected %g s",
                          observations_.back().time - observations_.front().time, rules_.window);
  }
  for (std::size_t k = 0; k + 1 < observations_.size(); ++k) {
    const auto moved = distanceBetween(observations_[k].tags, observations_.back().tags);
    if (!moved) return "the set of visible tags changed";
    const bool bodies = observations_.back().tags.front().points.has_value();
    const double most = bodies ? rules_.body_tolerance : rules_.corner_tolerance;
    if (*moved <= most) continue;
    const double unit = bodies ? 1e3 : 1;
    return basics::format("the %s moved by %.2f %s within %.2f s; expected at most %g %s",
                          bodies ? "bodies" : "tags", unit * *moved, bodies ? "mm" : "px",
                          observations_.back().time - observations_[k].time, unit * most,
                          bodies ? "mm" : "px");
  }
  return "";
}

Settling SettleWatch::at(double now) const {
  Settling out;
  out.set_point = set_point_;
  const auto fails = [&out](SettleState state, std::string reason) {
    out.state = state;
    out.reason = std::move(reason);
    return !out.reason.empty();
  };
  if (fails(SettleState::kStale, pressureStaleness(now)) ||
      fails(SettleState::kUnseen, pictureStaleness(now))) {
    return out;
  }
  const Observation& last = observations_.back();
  const char* const no_tags = "no tag of the arm is in sight; check the camera's picture";
  Eigen::VectorXd mean;
  if (fails(SettleState::kPressure, pressureFault(mean)) ||
      fails(SettleState::kNoTags, last.tags.empty() ? no_tags : "") ||
      fails(SettleState::kMoving, motion(windowBegin()))) {
    return out;
  }
  out.state = SettleState::kSettled;
  out.last = Sample{last.time, std::move(mean), last.tags};
  return out;
}

std::vector<Sample> SettleWatch::samples() const {
  std::vector<Sample> out;
  Eigen::VectorXd mean;
  pressureFault(mean);
  for (const Observation& observation : observations_)
    out.push_back({observation.time, mean, observation.tags});
  return out;
}

}  // namespace helix_arm::procedures
