#include "suspect_watch.hpp"

#include <algorithm>
#include <chrono>
#include <optional>
#include <utility>

#include "captures.hpp"

namespace helix_arm::procedures {
namespace {

// A capture is taken where no pressure has moved by this part of its range for so long: lags that
// the scene does not know have passed [s].
constexpr double kStill = 0.05, kHeld = 0.3;
// Least distance of captures, in parts of the range, and most captures; the oldest are forgotten.
constexpr double kApart = 0.08;
constexpr std::size_t kMost = 32;
// A later capture at about the same pressures replaces an older one; captures are forgotten [s].
constexpr double kOld = 10.0, kForgotten = 90.0;
// Limits of a search: fewest captures, beyond one per actuator, and new ones; least time after the
// last one, and after one that found suspects, which takes long [s].
constexpr std::size_t kLeast = 1;
constexpr int kLeastNew = 2;
constexpr double kPeriod = 3.0, kLongPeriod = 10.0;
// Factor on the deviations that the loop expects, in the noise of a search: the deviations of one
// arm are the same in all captures, and so weigh less in it than as many independent ones.
constexpr double kSound = 0.6;
// Change of a channel's pressures, relative to them, that is a mistake: a smaller one is as if the
// strokes varied, by which muscles differ.
constexpr double kMistake = 0.28;

// Covariance of a picture's twists about those of the model, for all that a sound arm may differ
// by, except stiffness, which is fitted; nothing if the model finds no shape.
std::optional<Eigen::MatrixXd> spreadOf(const estimation::ArmFilter& nominal,
                                        const estimation::ArmFilter::Input& picture) {
  const auto model = nominal.linearise(picture.pressure);
  if (!model) return std::nullopt;
  const std::vector<std::string>& names = nominal.parameterNames();
  Eigen::VectorXd theta = nominal.parameterPrior();
  for (Eigen::Index j = 0; j < theta.size(); ++j) {
    if (names[static_cast<std::size_t>(j)].rfind("K_", 0) == 0) theta[j] = 0.0;
  }
  const Eigen::MatrixXd by_theta = model->by_theta * theta.asDiagonal();
  const Eigen::MatrixXd by_pressure =
      model->by_pressure * picture.variance.cwiseSqrt().asDiagonal();
  Eigen::MatrixXd spread = by_theta * by_theta.transpose() + by_pressure * by_pressure.transpose();
  spread.diagonal() += nominal.biasDeviation().cwiseAbs2();
  // A value that is not measured, as out of a plane, says nothing.
  Eigen::MatrixXd out =
      Eigen::MatrixXd::Identity(picture.covariance.rows(), picture.covariance.cols());
  out(nominal.rows(), nominal.rows()) = picture.covariance(nominal.rows(), nominal.rows()) + spread;
  return kSound * kSound * out;
}

// Whether it is one of the pressures, and changes them by more than sound muscles differ.
bool isMistake(const estimation::Suspect& suspect, const estimation::ArmCaptures& arm) {
  if (suspect.corrected.empty()) return false;
  Eigen::VectorXd change = Eigen::VectorXd::Zero(arm.arm.actuatorCount()), all = change;
  for (std::size_t k = 0; k < arm.captures.size(); ++k) {
    const Eigen::VectorXd& read = arm.captures[k].pressure;
    change += (suspect.corrected.front().captures[k].pressure - read).cwiseAbs();
    all += read;
  }
  return (change.array() > kMistake * all.array()).any();
}

std::vector<estimation::Suspect> suspectsIn(
    estimation::ArmCaptures arm, const estimation::ArmFilter& nominal,
    const std::vector<estimation::ArmFilter::Input>& pictures, double stiffness_deviation,
    const std::atomic<bool>& stop) {
  for (const estimation::ArmFilter::Input& picture : pictures) {
    const auto spread = spreadOf(nominal, picture);
    if (!spread) continue;
    arm.captures.push_back({static_cast<int>(arm.captures.size()) + 1,
                            arm.arm.clamped(picture.pressure),
                            estimation::TwistReading{picture.twists, *spread}, picture.time});
  }
  estimation::CalibrationOptions options;
  options.stiffness_prior = stiffness_deviation;
  std::vector<estimation::Suspect> found =
      estimation::suspectsOf({arm}, options, [&stop] { return stop.load(); });
  found.erase(std::remove_if(found.begin(), found.end(),
                             [&arm](const auto& one) { return !isMistake(one, arm); }),
              found.end());
  return found;
}

}  // namespace

SuspectWatch::SuspectWatch(const io::Scene& scene)
    : arm_(makeArmCaptures(scene, {})),
      model_(scene.model),
      expected_(scene.follow.filter),
      range_(scene.arm.inputAt(1.0) - scene.arm.inputAt(0.0)) {
  expected_.planar = scene.vision.fit.planar;
}

SuspectWatch::~SuspectWatch() {
  if (stop_) *stop_ = true;
}

bool SuspectWatch::see(follow::VisualServo& loop, const estimation::Observation& observation,
                       bool waits) {
  if (observation.accepted() || observation.fault == estimation::ObservationFault::kOutlier) {
    note(loop);
  }
  if (!running_.valid()) search();
  if (!running_.valid()) return false;
  if (!waits && running_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) {
    return false;
  }
  suspects_ = running_.get();
  sound_ = suspects_.empty();
  loop.distrustModel(!sound_);
  return true;
}

void SuspectWatch::note(const follow::VisualServo& loop) {
  const estimation::ArmFilter::Input& picture = loop.seen();
  const bool changed = loop.load().contact || loop.drift().doubtful;
  // A change in a sound arm, as a muscle that loses its hose, shows in later captures alone.
  if (changed && !changed_ && sound_) {
    kept_.clear();
    sound_ = false;
  }
  changed_ = changed;
  if (isStill(picture.time, picture.pressure)) keep(picture);
}

bool SuspectWatch::isStill(double time, const Eigen::VectorXd& pressure) {
  if (time < held_since_) kept_.clear();  // the clock was set back
  const bool same = held_.size() != 0 && time >= held_since_ && distance(held_, pressure) < kStill;
  if (!same) {
    held_ = pressure;
    held_since_ = time;
  }
  return time - held_since_ >= kHeld;
}

double SuspectWatch::distance(const Eigen::VectorXd& one, const Eigen::VectorXd& other) const {
  return (one - other).cwiseQuotient(range_).cwiseAbs().maxCoeff();
}

void SuspectWatch::keep(const estimation::ArmFilter::Input& picture) {
  const auto isOld = [&](const auto& one) { return picture.time - one.time > kForgotten; };
  kept_.erase(std::remove_if(kept_.begin(), kept_.end(), isOld), kept_.end());
  const auto near = std::find_if(kept_.begin(), kept_.end(), [&](const auto& one) {
    return distance(one.pressure, picture.pressure) < kApart;
  });
  if (near != kept_.end()) {
    if (picture.time - near->time < kOld) return;
    kept_.erase(near);
  }
  if (kept_.size() == kMost) kept_.erase(kept_.begin());
  kept_.push_back(picture);
  ++new_;
}

void SuspectWatch::search() {
  const std::size_t least = kLeast + static_cast<std::size_t>(range_.size());
  if (kept_.size() < least || new_ < kLeastNew) return;
  const double since = kept_.back().time - searched_at_;
  if (since >= 0 && since < (suspects_.empty() ? kPeriod : kLongPeriod)) return;
  searched_at_ = kept_.back().time;
  new_ = 0;
  running_ = std::async(std::launch::async, [arm = arm_, model = model_, expected = expected_,
                                             pictures = kept_, stop = stop_] {
    return suspectsIn(arm, estimation::ArmFilter(model, expected), pictures,
                      expected.stiffness_deviation.kappa, *stop);
  });
}

estimation::Suspect suspectOf(const estimation::BaseMove& move) {
  // The share of the square of its distance from where it should be: all but what chance explains.
  const double by_chance = 6.0 / (move.deviations * move.deviations);
  return {"camera_moved", "the camera or the base", 1.0 - by_chance, move.message()};
}

}  // namespace helix_arm::procedures
