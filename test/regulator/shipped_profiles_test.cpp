// Lines that the shipped serial profiles say, as manuals have them: emulators of the same profiles
// would share a mistake.
#include <string>

#include <gtest/gtest.h>

#include "io/scene/regulator_profile.hpp"
#include "regulator/line_format.hpp"

namespace helix_arm::regulator {
namespace {

TEST(ShippedProfiles, SayLinesInTheUnitsOfTheirDevices) {
  struct Row {
    const char *name, *set, *vent;  // 100 kPa to channel A
    int baud;
  };
  for (const Row& row :
       {Row{"alicat", "AS14.50", "AS0.00", 19200}, Row{"ctrl_p", "set;0;100.00", "mode;0", 115200},
        Row{"generic", "pA=100.00", "pA=vent", 115200}}) {
    const auto profile = std::get<SerialProfile>(io::loadRegulatorProfile(row.name));
    const LineStyle style{profile.separator, profile.unit_word, profile.decimals};
    const LineFields fields{{profile.fromPascals(1e5)}, {}, {}};
    EXPECT_EQ(LineFormat(profile.write, style).line("A", fields), row.set);
    EXPECT_EQ(LineFormat(profile.vent.back(), style).line("A", {}), row.vent);
    EXPECT_EQ(profile.baud, row.baud);
    EXPECT_EQ(profile.highest < 1e9, std::string(row.name) == "generic");
  }
}

}  // namespace
}  // namespace helix_arm::regulator
