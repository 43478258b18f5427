#include "helix_arm/simulation/rig.hpp"
