#include "ros_bridge/follow/path_checker.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <system_error>
#include <utility>

namespace helix_arm::ros_bridge {
namespace {

bool isReady(const std::future<DecidedGoal>& result) {
  return result.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
}

}  // namespace

PathChecker::~PathChecker() {
  discard();  // the futures wait
}

void PathChecker::begin(Check check) {
  discard();
  waiting_ = std::move(check);
  start();
}

void PathChecker::discard() {
  waiting_ = nullptr;
  if (!present_) return;
  *present_->stop = true;
  discarded_.push_back(std::move(*present_));
  present_.reset();
}

std::optional<DecidedGoal> PathChecker::take() {
  start();
  if (!present_ || !isReady(present_->result)) return std::nullopt;
  Run run = std::move(*present_);
  present_.reset();
  try {
    return run.result.get();
  } catch (const std::exception& fault) {
    return GoalEnding{FollowTipPathResult::INVALID_GOAL, fault.what()};
  }
}

void PathChecker::start() {
  discarded_.erase(std::remove_if(discarded_.begin(), discarded_.end(),
                                  [](const Run& run) { return isReady(run.result); }),
                   discarded_.end());
  if (!waiting_ || discarded_.size() >= kMostThreads) return;
  const auto stop = std::make_shared<std::atomic<bool>>(false);
  try {
    auto result = std::async(std::launch::async, [check = waiting_, stop] { return check(*stop); });
    present_.emplace(Run{stop, std::move(result)});
    waiting_ = nullptr;
  } catch (const std::system_error&) {
    // The system has no thread left; it may have one the next time.
  }
}

}  // namespace helix_arm::ros_bridge
