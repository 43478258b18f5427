#include "helix_arm/vision/frame_source.hpp"
