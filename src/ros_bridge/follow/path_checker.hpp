#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <vector>

#include "ros_bridge/follow/path_goal.hpp"

namespace helix_arm::ros_bridge {

/// Reads and checks one goal after the other in threads of its own, at most kMostThreads at a time.
///
/// A check that is replaced or discarded is told to stop, and nobody waits for it. While too many
/// have not stopped yet, the present check waits; if it is replaced meanwhile, it never runs.
///
/// For one thread, except the checks.
class PathChecker {
 public:
  static constexpr std::size_t kMostThreads = 2;
  /// Decides a goal. Runs in another thread; once `stop` is set it should return soon, whatever it
  /// returns.
  using Check = std::function<DecidedGoal(const std::atomic<bool>& stop)>;

  PathChecker() = default;
  /// Tells all checks to stop, and waits for them.
  ~PathChecker();
  PathChecker(const PathChecker&) = delete;
  PathChecker& operator=(const PathChecker&) = delete;

  /// Begins a check, in place of the present one.
  void begin(Check check);
  /// Gives the present check up.
  void discard();
  /// The result of the present check, once; what a check throws refuses its goal. To be called
  /// regularly: it also begins a check that waits.
  std::optional<DecidedGoal> take();

 private:
  struct Run {
    std::shared_ptr<std::atomic<bool>> stop;
    std::future<DecidedGoal> result;
  };

  void start();

  Check waiting_;               ///< empty: none
  std::optional<Run> present_;  ///< begun
  std::vector<Run> discarded_;  ///< told to stop
};

}  // namespace helix_arm::ros_bridge
