#pragma once

#include <algorithm>
#include <functional>
#include <mutex>
#include <optional>
#include <vector>

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include "helix_arm/ArmShape.h"
#include "helix_arm/PressureArray.h"
#include "helix_arm/TargetStatus.h"
#include "helix_arm/TipTarget.h"
#include "ros_bridge/names.hpp"
#include "support/eventually.hpp"
#include "support/has.hpp"

namespace helix_arm::test {

namespace names = ros_bridge::names;

/// Handles callbacks until the condition holds; false when it did not within the deadline [s].
inline bool waitFor(const std::function<bool()>& condition, double deadline = 60.0) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(deadline);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end || !ros::ok()) return false;
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.01));
  }
  return true;
}

/// All messages of a topic, in the order they came.
template <class Message>
class Inbox {
 public:
  Inbox(ros::NodeHandle& node, const std::string& topic)
      : subscriber_(node.subscribe<Message>(
            topic, 1000, [this](const typename Message::ConstPtr& m) { messages_.push_back(m); })) {
  }

  const std::vector<typename Message::ConstPtr>& all() const { return messages_; }
  const Message& last() const { return *messages_.back(); }

  /// Waits for a message that came after this call and for which the predicate holds; null when
  /// none did.
  typename Message::ConstPtr next(const std::function<bool(const Message&)>& predicate) {
    std::size_t looked_at = messages_.size();
    typename Message::ConstPtr found;
    waitFor([&] {
      for (; looked_at < messages_.size() && !found; ++looked_at) {
        if (predicate(*messages_[looked_at])) found = messages_[looked_at];
      }
      return found != nullptr;
    });
    return found;
  }

 private:
  std::vector<typename Message::ConstPtr> messages_;
  ros::Subscriber subscriber_;
};

/// The main of a rostest.
inline int runRostest(int argc, char** argv) {
  ::testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test", ros::init_options::AnonymousName);
  const ros::NodeHandle started;
  return RUN_ALL_TESTS();
}

}  // namespace helix_arm::test
