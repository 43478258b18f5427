#pragma once

#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include <xmlrpcpp/XmlRpcValue.h>

#include "helix_arm/basics/mutex.hpp"

namespace helix_arm::ros_bridge {

/// What became of a call of the XML-RPC interface of the master or of a node.
enum class Reply {
  kSuccess,
  kFailure,  ///< it answers that it failed
  kHangs,    ///< no answer within MasterWatch::kPatience
  kIsGone,   ///< nobody is there, or it ended
};

/// Calls and waits for at most MasterWatch::kPatience, unlike ros::master::execute(), which waits
/// without end for one that hangs.
///
/// @param answer  the value of a success.
Reply callXmlRpc(const std::string& host, int port, const char* method,
                 const XmlRpc::XmlRpcValue& question, XmlRpc::XmlRpcValue& answer);

/// Asks the node to end if its ROS master is gone, hangs, or was restarted and does not know the
/// node; roscpp notices none of these.
///
/// Queries the master from its own thread and waits at most kPatience for an answer, so that a
/// hanging master blocks nothing.
class MasterWatch {
 public:
  static constexpr double kPatience = 2;  ///< for an answer [s]

  /// @param period  time between two queries.
  /// @param misses  number of unanswered queries in a row after which the master counts as gone, >=
  /// 1.
  explicit MasterWatch(std::chrono::milliseconds period = std::chrono::seconds(1), int misses = 3);
  /// Waits at most kPatience.
  ~MasterWatch();
  MasterWatch(const MasterWatch&) = delete;
  MasterWatch& operator=(const MasterWatch&) = delete;

  /// True once the master is gone and the node was asked to end.
  bool lost() const { return lost_; }

 private:
  void watch(std::chrono::milliseconds period, int misses);

  basics::Mutex mutex_;
  basics::Condition wake_;
  bool stop_ HELIX_ARM_GUARDED_BY(mutex_) = false;
  std::atomic<bool> lost_{false};
  std::thread thread_;
};

/// Whether the ROS master answers within MasterWatch::kPatience; unlike ros::master::check(), which
/// waits for one that hangs without end.
bool masterAnswers();

}  // namespace helix_arm::ros_bridge
