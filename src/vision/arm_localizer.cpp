#include "helix_arm/vision/arm_localizer.hpp"
