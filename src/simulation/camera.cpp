#include "helix_arm/simulation/camera.hpp"
