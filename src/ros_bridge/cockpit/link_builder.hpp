#pragma once

#include <memory>
#include <string>

#include "ros_bridge/cockpit/cockpit_link.hpp"

namespace helix_arm::ros_bridge {

/// Makes and ends a CockpitLink in threads of its own: both ask the ROS master, and whoever asks
/// for a link must not wait for one that is gone or hangs. No function waits.
class LinkBuilder {
 public:
  LinkBuilder();
  /// What is under way ends in its own time.
  ~LinkBuilder();
  LinkBuilder(const LinkBuilder&) = delete;
  LinkBuilder& operator=(const LinkBuilder&) = delete;

  /// Begins to connect to the arm of this namespace as soon as the master answers, in place of any
  /// other arm.
  /// @throws ros::InvalidNameException if the namespace is no name; what is under way goes on.
  void begin(const std::string& ns);
  /// Gives up on what is under way.
  void cancel();

  /// The link once it is there, once; null otherwise.
  /// @throws what its constructor threw.
  std::unique_ptr<CockpitLink> take();

  /// Resolved namespace of the arm to which a connection is under way; empty if there is none.
  std::string connectingTo() const;
  /// URI of the ROS master if that connection waits for it; empty otherwise.
  std::string silentMaster() const;

  /// Ends a link.
  static void end(std::unique_ptr<CockpitLink> link);

 private:
  struct State;
  const std::shared_ptr<State> state_;
};

}  // namespace helix_arm::ros_bridge
