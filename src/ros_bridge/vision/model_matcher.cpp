#include "ros_bridge/vision/model_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

// Time that a picture waits for the model of its stamp. At 100 Hz and more the model has arrived by
// then, so a replay uses the same models.
constexpr std::chrono::milliseconds kModelPatience(100);
// Each wait in vain halves the patience, down to this, so that models that always lag do not slow
// the pictures down.
constexpr std::chrono::milliseconds kLeastPatience(5);

// Expected shape before the first model arrives.
model::Shape restingShape(const io::Scene& scene) {
  const Eigen::VectorXd rest = scene.arm.inputAt(0);
  const statics::Solution solution = scene.model.solve(rest);
  if (!solution.converged()) {
    logWarning(
        "%s: the model finds no shape of the resting arm (%s, residual %.2g): tags are expected "
        "where they are without load until a model is received",
        scene.name.c_str(), statics::nameOf(solution.status), solution.residual);
  }
  return statics::startingShape(scene.model, solution, rest);
}

}  // namespace

ModelMatcher::ModelMatcher(const io::Scene& scene, VisionStatusPublisher& status)
    : status_(status), start_(restingShape(scene)), patience_(kModelPatience) {}

void ModelMatcher::add(const ros::Time& stamp, const model::Shape& shape) {
  {
    const basics::MutexLock lock(mutex_);
    models_.add(stamp, shape);
  }
  changed_.notifyAll();
}

void ModelMatcher::stop() {
  {
    const basics::MutexLock lock(mutex_);
    stop_ = true;
  }
  changed_.notifyAll();
}

void ModelMatcher::restart(const io::Scene& scene) { start_ = restingShape(scene); }

ModelMatcher::LookUp ModelMatcher::lookUp(const ros::Time& stamp) {
  basics::MutexLock lock(mutex_);
  const std::optional<double> ahead = models_.lag(stamp);
  models_.forgetFuture(stamp);
  const bool waits = models_.mayGetNearer(stamp);
  const auto due = std::chrono::steady_clock::now() + patience_;
  const bool in_time = changed_.waitUntil(lock, due, [&]() HELIX_ARM_REQUIRES(mutex_) {
    return stop_ || !models_.mayGetNearer(stamp);
  });
  if (!in_time) {
    patience_ = std::max(kLeastPatience, patience_ / 2);
  } else if (waits) {
    patience_ = std::min(kModelPatience, 2 * patience_);
  }
  const std::optional<double> lag = models_.lag(stamp);
  return {models_.nearest(stamp), lag ? lag : ahead, in_time};
}

void ModelMatcher::warnOfLag(double lag) {
  if (!late_models_.add()) return;
  logWarning(
      "models are stamped %.3f s %s the pictures (%lu times so far): is pressure_command "
      "running, and are the clocks of the camera's and the arm's computers synchronised? Without "
      "a shape that balances the load there is no model: see `%s` in its diagnostics",
      std::abs(lag), lag < 0 ? "after" : "before", static_cast<unsigned long>(late_models_.total()),
      names::kModelStatus);
}

std::optional<ModelHistory::Entry> ModelMatcher::match(const ros::Time& stamp) {
  LookUp found = lookUp(stamp);
  status_.modelLag(found.lag);
  if (found.lag && (!found.in_time || std::abs(*found.lag) > ModelHistory::kReach)) {
    warnOfLag(*found.lag);
  }
  if (found.model) start_ = found.model->shape;
  return std::move(found.model);
}

}  // namespace helix_arm::ros_bridge
