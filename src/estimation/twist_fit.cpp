#include "helix_arm/estimation/twist_fit.hpp"
