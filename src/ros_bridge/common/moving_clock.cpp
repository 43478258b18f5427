#include "ros_bridge/common/moving_clock.hpp"

namespace helix_arm::ros_bridge {

double MovingClock::now() {
  const ros::Time time = ros::Time::now();
  const ros::SteadyTime steady = ros::SteadyTime::now();
  if (time != last_ || since_.isZero()) since_ = steady;
  last_ = time;
  const double still = (steady - since_).toSec();
  stands_ = still > kPatience;
  return stands_ ? time.toSec() + still : time.toSec();
}

}  // namespace helix_arm::ros_bridge
