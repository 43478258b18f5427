#pragma once

#include <functional>
#include <memory>
#include <string>

namespace helix_arm::ros_bridge {

/// Answer to a call that a user asked for.
struct CallAnswer {
  std::string what;  ///< name of the call, such as "Enable"
  bool success = false;
  std::string message;      ///< of the service; or why there is no answer
  bool answered = true;     ///< false: nothing answered, so the call may or may not have arrived
  std::string remedy = {};  ///< what the user has to do where the call failed; empty: nothing
};

/// Calls services in threads of their own, so that whoever asks is never blocked, and gives up on
/// those that do not answer in time.
///
/// Calls do not wait for each other: a service that hangs delays no emergency stop. A call that was
/// given up on may still end later; its answer is then dropped.
class CallDesk {
 public:
  /// Makes the call in a thread of its own; what it throws is the answer.
  using Call = std::function<CallAnswer()>;
  /// Gets exactly one answer per call, from some thread, and none after the destructor of the desk.
  using Done = std::function<void(const CallAnswer&)>;

  /// At most so many calls of one name wait for an answer; further ones are refused. Those given up
  /// on do not count: a fifth emergency stop still goes out to a node that has come back.
  static constexpr int kMostWaiting = 4;
  /// At most so many calls of one name have a thread, with those that were given up on.
  static constexpr int kMostRunning = 64;

  explicit CallDesk(Done done);
  ~CallDesk();
  CallDesk(const CallDesk&) = delete;
  CallDesk& operator=(const CallDesk&) = delete;

  /// @param what     name of the call in its answer.
  /// @param limit    time in which it must answer, > 0 [s].
  /// @param call     Must not refer to anything that may end before it.
  /// @param remedy   of its answer, however the call fails.
  void ask(const std::string& what, double limit, Call call, const std::string& remedy = {});
  /// Whether a call of this name waits for its answer; one that was given up on does not.
  bool waits(const std::string& what) const;

 private:
  struct State;
  const std::shared_ptr<State> state_;
};

}  // namespace helix_arm::ros_bridge
