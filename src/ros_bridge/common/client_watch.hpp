#pragma once

#include <atomic>
#include <limits>
#include <string>
#include <utility>

#include "basics/mutex.hpp"
#include "run_node.hpp"

/// Whether the master and the sender of a goal are there.
namespace helix_arm::ros_bridge {

/// Outcome of a call of the XML-RPC interface of the master or of a node.
enum class Reply {
  kSuccess,
  kFailure,  ///< it answers that it failed
  kHangs,    ///< no answer within 2 s
  kIsGone,   ///< nobody is there, or it ended
};

/// Asks the master for this node, which a restarted one does not know and nobody can then find.
Reply askMaster();

/// Whether the ROS master answers within 2 s; unlike ros::master::check(), which
/// waits for one that hangs without end.
inline bool masterAnswers() {
  const Reply answer = askMaster();
  return answer == Reply::kSuccess || answer == Reply::kFailure;
}

/// Whether another node is still there: an arm that it set in motion has a living commander.
///
/// Asks the node itself (getPid of its XML-RPC interface) from a thread of its own, kPeriod after
/// each answer. It is gone after kMisses questions in a row without an answer, which is within 1 s
/// after its process has ended, since nobody listens on its port; and kLongestSilence after its
/// last answer, where it was stopped, or its machine or the network was cut off. Thread-safe.
class ClientWatch {
 public:
  static constexpr double kPeriod = 0.25;  ///< [s]
  static constexpr int kMisses = 3;
  static constexpr double kLongestSilence = 7.0;  ///< [s]

  /// Watches this node from now on, in place of another. @param node  its name; empty: gone.
  void watch(const std::string& node);
  /// Watches no node.
  void release();

  /// Whether the watched node is gone. Takes no lock.
  bool isGone() const;
  /// The fault, and the remedy.
  std::string whyGone() const;

 private:
  /// One question.
  void ask() HELIX_ARM_EXCLUDES(mutex_);
  /// Asks it. @param uri  of its interface; empty: still to be looked up.
  static bool answers(const std::string& node, std::string& uri);

  static constexpr double kInfinity = std::numeric_limits<double>::infinity();

  mutable basics::Mutex mutex_;
  std::string node_ HELIX_ARM_GUARDED_BY(mutex_);     ///< empty: none
  unsigned number_ HELIX_ARM_GUARDED_BY(mutex_) = 0;  ///< of watched nodes so far
  std::atomic<bool> gone_{false};
  /// Time of the last answer on the steady clock; infinite while no node is watched [s].
  std::atomic<double> last_answer_{kInfinity};
  // State of the thread that asks.
  std::string uri_;
  unsigned asked_ = 0;  ///< number of the node
  int misses_ = 0;
  Ticker ticker_{kPeriod, [this] {  // last: its end waits for an answer, at most 2 s
                   ask();
                   return true;
                 }};
};

}  // namespace helix_arm::ros_bridge
