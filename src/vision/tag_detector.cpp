#include "helix_arm/vision/tag_detector.hpp"
