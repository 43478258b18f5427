#include "helix_arm/vision/tag_tracker.hpp"
