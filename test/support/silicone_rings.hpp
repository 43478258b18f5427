#pragma once

#include <optional>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "procedures/response_series.hpp"

namespace helix_arm::test {

inline constexpr char kSiliconeRings[] = HELIX_ARM_SOURCE_DIR "/../shared/data/silicone_rings.csv";

/// Releases of a silicone segment at three pressures (srl-ethz/diffPD_sim2real, MIT licence);
/// nothing where they are not at hand.
inline std::optional<procedures::ResponseSeries> siliconeRings() {
  try {
    return procedures::tipSeriesOf(io::loadDataSet(kSiliconeRings), 3);
  } catch (const io::DocumentError&) {
    return std::nullopt;
  }
}

}  // namespace helix_arm::test
