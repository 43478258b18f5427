#include "helix_arm/vision/tag_family.hpp"
