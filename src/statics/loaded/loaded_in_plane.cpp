#include "loaded_arm.hpp"

namespace helix_arm::statics {

template class LoadedArmOf<lie::SE2>;

}  // namespace helix_arm::statics
