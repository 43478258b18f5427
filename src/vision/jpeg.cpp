#include "helix_arm/vision/jpeg.hpp"
