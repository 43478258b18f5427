// Every rule of the schema, broken once.

#include <gtest/gtest.h>

#include "scene_faults.hpp"
#include "support/scene_text.hpp"

namespace helix_arm::io {
namespace {

using test::BrokenRule;
using test::faultsOf;
using test::kPlanarScene;
using test::kSpatialScene;
using test::replaced;

class SpatialSceneRules : public testing::TestWithParam<BrokenRule> {};
class PlanarSceneRules : public testing::TestWithParam<BrokenRule> {};

TEST_P(SpatialSceneRules, BreakingOneIsReported) {
  ASSERT_TRUE(faultsOf(kSpatialScene).empty());
  EXPECT_EQ(faultsOf(replaced(kSpatialScene, GetParam().from, GetParam().to)), GetParam().faults);
}

TEST_P(PlanarSceneRules, BreakingOneIsReported) {
  ASSERT_TRUE(faultsOf(kPlanarScene).empty());
  EXPECT_EQ(faultsOf(replaced(kPlanarScene, GetParam().from, GetParam().to)), GetParam().faults);
}

const BrokenRule kNumbers[] = {
    {"radius_m: 0.03",
     "radius_m: -5",
     {":18 arm.sections[0].ring.radius_m is -5; expected a finite value > 0"}},
    {"radius_m: 0.03",
     "radius_m: .nan",
     {":18 arm.sections[0].ring.radius_m is .nan; expected a finite value > 0"}},
    {"radius_m: 0.03",
     "radius_m: wide",
     {":18 arm.sections[0].ring.radius_m is wide; expected a finite value > 0"}},
    {"radius_m: 0.03",
     "radius_m: \"0.03\"",
     {":18 arm.sections[0].ring.radius_m is \"0.03\"; expected a finite value > 0"}},
    {"radius_m: 0.03",
     "radius_m: [0.03]",
     {":18 arm.sections[0].ring.radius_m has 1 entries; expected one number, or a list of 2 to 9"}},
    {"radius_m: 0.03",
     "radius_m: [0.03, -0.02]",
     {":18 arm.sections[0].ring.radius_m[1] is -0.02; expected a finite value > 0"}},
    {"radius_m: 0.03, tilt_deg: 10",
     "radius_m: [0.03, 0.02], tilt_deg: [10, 5, 0]",
     {":18 arm.sections[0].ring.tilt_deg has 3 values; expected 2, as many as radius_m, or one "
      "number"}},
    {"radius_m: 0.03",
     "radius_m: ",
     {":18 arm.sections[0].ring.radius_m is empty; expected a finite value > 0"}},
    {"count: 3",
     "count: 2.5",
     {":18 arm.sections[0].ring.count is 2.5; expected a whole number from 1 to 24"}},
    {"count: 3",
     "count: 25",
     {":18 arm.sections[0].ring.count is 25; expected a whole number from 1 to 24"}},
    {"tilt_deg: 10",
     "tilt_deg: 90",
     {":18 arm.sections[0].ring.tilt_deg is 90; expected an angle above -90 and below 90"}},
    {"length_scale: 1",
     "length_scale: 0.4",
     {":18 arm.sections[0].ring.length_scale is 0.4; expected 0.5 to 2"}},
    {"length_scale: 1",
     "length_scale: [1, 1.01]",
     {":18 arm.sections[0].ring.length_scale has 2 entries; expected a list of 3 numbers, each a "
      "finite value > 0"}},
    {"length_scale: 1",
     "length_scale: [1, 1.01, 3]",
     {":18 arm.sections[0].ring.length_scale[2] is 3; expected 0.5 to 2"}},
    {"length_scale: 1",
     "length_scale: long",
     {":18 arm.sections[0].ring.length_scale is long; expected a finite value > 0"}},
    {"tilt_deg: 12",
     "length_scale: [1]",
     {":29 arm.sections[1].actuators[2].length_scale is a list; expected a finite value > 0"}},
    {"separators: 5",
     "separators: 1",
     {":19 arm.sections[0].separators is 1; expected a whole number from 2 to 1000"}},
    {"separator_radius_m: 0.04",
     "separator_radius_m: 0",
     {":20 arm.sections[0].separator_radius_m is 0; expected a finite value > 0"}},
    {"muscle_radius_m: 0.01",
     "muscle_radius_m: -1",
     {":21 arm.sections[0].muscle_radius_m is -1; expected a finite value > 0"}},
    {"K_gamma: 10",
     "K_gamma: -1",
     {":15 arm.stiffness.K_gamma is -1; expected a finite value >= 0"}},
    {"K_tau_m2: 0,",
     "K_tau_m2: inf,",
     {":15 arm.stiffness.K_tau_m2 is inf; expected a finite value >= 0"}},
    {"K_kappa_m2: 1.0e-4",
     "K_kappa_m2: 1e999",
     {":15 arm.stiffness.K_kappa_m2 is 1e999; expected a finite value >= 0"}},
    {"[0.1, 0.2, 1]",
     "[0.1, 0.2]",
     {":14 arm.base.position_m has 2 entries; expected a list of 3 numbers, each a finite value"}},
    {"[10, 90, 20]",
     "[10, .inf, up]",
     {":14 arm.base.rpy_deg[1] is .inf; expected a finite value",
      ":14 arm.base.rpy_deg[2] is up; expected a finite value"}},
    {"[10, 90, 20]",
     "90",
     {":14 arm.base.rpy_deg is 90; expected a list of 3 numbers, each a finite value"}},
    {"time_constant_s: 0.2",
     "time_constant_s: 0",
     {":33 regulator.simulated.time_constant_s is 0; expected a finite value > 0"}},
    {"time_constant_s: 0.2",
     "fall_time_constant_s: 0",
     {":33 regulator.simulated.fall_time_constant_s is 0; expected a finite value > 0"}},
    {"time_constant_s: 0.2",
     "dead_time_s: 1.5",
     {":33 regulator.simulated.dead_time_s is 1.5; expected 0 to 1 s"}},
    {"supply_kpa: 450",
     "supply_kpa: -1",
     {":33 regulator.simulated.supply_kpa is -1; expected a finite value > 0"}},
    {"noise_kpa: 2",
     "noise_kpa: -2",
     {":33 regulator.simulated.noise_kpa is -2; expected a finite value >= 0"}},
    {"seed: 7",
     "seed: 4294967296",
     {":33 regulator.simulated.seed is 4294967296; expected a whole number from 0 to 4294967295"}},
    {"commander_timeout_s: 0.8",
     "commander_timeout_s: 0",
     {":34 safety.commander_timeout_s is 0; expected a finite value > 0"}},
};
INSTANTIATE_TEST_SUITE_P(Numbers, SpatialSceneRules, testing::ValuesIn(kNumbers));

// A response of the bellows, and what is said of it.
struct BrokenResponse {
  const char* text;
  const char* fault;
};

class SceneResponseRules : public testing::TestWithParam<BrokenResponse> {};

TEST_P(SceneResponseRules, BreakingOneIsReported) {
  const std::string curve = "length_m: [0.1, 0.12, 0.13]}\n";
  const auto with = [&](const std::string& response) {
    return faultsOf(replaced(kSpatialScene, curve, curve + "    response: " + response + "\n"));
  };
  ASSERT_TRUE(with("{}").empty());
  ASSERT_TRUE(with("{play_kpa: [20, 60], play_weight: [0.3, 0.65]}").empty());
  EXPECT_EQ(with(GetParam().text),
            std::vector<std::string>{std::string(":10 contractions.bellows.response") +
                                     GetParam().fault});
}

const BrokenResponse kResponses[] = {
    {"0.5",
     " is 0.5; expected a map of rise_time_constant_s, fall_time_constant_s, play_kpa or "
     "play_weight"},
    {"{rise_time_s: 0.5}",
     ".rise_time_s is not a known key; expected rise_time_constant_s, "
     "fall_time_constant_s, play_kpa or play_weight"},
    {"{rise_time_constant_s: -1}", ".rise_time_constant_s is -1; expected a finite value >= 0"},
    {"{rise_time_constant_s: 61}", ".rise_time_constant_s is 61; expected 0 to 60 s"},
    {"{fall_time_constant_s: .nan}", ".fall_time_constant_s is .nan; expected a finite value >= 0"},
    {"{play_kpa: [20]}",
     ".play_weight is missing; expected a list of 1 numbers, each a finite value >= 0"},
    {"{play_weight: [0.2]}", ".play_weight is given without play_kpa; expected both or none"},
    {"{play_kpa: [], play_weight: []}",
     ".play_kpa is empty; expected 1 to 4 numbers, or leave out play_kpa and play_weight "
     "for none"},
    {"{play_kpa: [20, 20], play_weight: [0.1, 0.1]}",
     ".play_kpa has 20 after 20; expected ascending values"},
    {"{play_kpa: [1, 2, 3, 4, 5], play_weight: [0.1, 0.1, 0.1, 0.1, 0.1]}",
     ".play_kpa has 5 entries; expected at most 4"},
    {"{play_kpa: [-20], play_weight: [0.1]}", ".play_kpa[0] is -20; expected a finite value > 0"},
    {"{play_kpa: [20, 60], play_weight: [0.1]}",
     ".play_weight has 1 entries; expected a list of 2 numbers, each a finite value >= 0"},
    {"{play_kpa: [20], play_weight: [-0.1]}",
     ".play_weight[0] is -0.1; expected a finite value >= 0"},
    {"{play_kpa: [20, 60], play_weight: [0.5, 0.46]}",
     ".play_weight has the sum 0.96; expected at most 0.95, so that every length belongs "
     "to one pressure"},
};
INSTANTIATE_TEST_SUITE_P(Responses, SceneResponseRules, testing::ValuesIn(kResponses));

TEST(SceneResponse, ATendonHasNone) {
  const std::string tendon = "    tendon: {length_m: 0.3";
  EXPECT_EQ(faultsOf(replaced(kSpatialScene, tendon,
                              "    response: {rise_time_constant_s: 1}\n" + tendon)),
            std::vector<std::string>{
                ":11 contractions.cable.response is given for a tendon, which follows its spool; "
                "expected it only where the input is a pressure"});
}

const BrokenRule kKeys[] = {
    {"radius_m: 0.03",
     "radus_m: 0.03",
     {":18 arm.sections[0].ring.radus_m is not a known key; did you mean radius_m?",
      ":18 arm.sections[0].ring.radius_m is missing; expected a finite value > 0"}},
    {"safety:",
     "zzz: 1\nsafety:",
     {":34 zzz is not a known key; expected name, contractions, arm, load, tier, order, accuracy, "
      "budget, tags, camera, vision, simulation, regulator, safety, follow or calibration"}},
    {"K_tau_m2: 0, ", "", {":15 arm.stiffness.K_tau_m2 is missing; expected a finite value >= 0"}},
    {"  geometry: spatial\n", "", {":12 arm.geometry is missing; expected planar or spatial"}},
    {"geometry: spatial",
     "geometry: flat",
     {":13 arm.geometry is flat; expected planar or spatial"}},
    {"name: rig\n", "", {":1 name is missing; expected a word of letters, digits, _ and -"}},
    {"name: rig",
     "name: my rig",
     {":1 name is my rig; expected a word of letters, digits, _ and -"}},
    {"    - name: lower\n      ring",
     "    - ring",
     {":17 arm.sections[0].name is missing; expected a word of letters, digits, _ and -"}},
    {"name: lower",
     "name: [a]",
     {":17 arm.sections[0].name is a list; expected a word of letters, digits, _ and -"}},
    {"name: upper",
     "name: lower",
     {":22 arm.sections[1].name is lower; expected a name that no other section has"}},
    {"name: top",
     "name: left",
     {":27 arm.sections[1].actuators[2].name makes a second actuator named left; expected distinct "
      "names"}},
    {"name: top",
     "name: muscle_2",
     {":27 arm.sections[1].actuators[2].name makes a second actuator named muscle_2; expected "
      "distinct names"}},
    {"separators: 5",
     "separators: 5\n      separators: 6",
     {":20 arm.sections[0].separators is given twice; expected it once"}},
    {"  bellows:",
     "  muscle:",
     {":8 contractions.muscle is given twice; expected it once",
      ":25 arm.sections[1].actuators[0].contraction is bellows; expected one of contractions: "
      "cable or muscle",
      ":26 arm.sections[1].actuators[1].contraction is bellows; expected one of contractions: "
      "cable or muscle",
      ":30 arm.sections[1].actuators[2].contraction is bellows; expected one of contractions: "
      "cable or muscle"}},
    {"  simulated: {time_constant_s: 0.2, supply_kpa: 450, noise_kpa: 2, seed: 7}",
     "  {}",
     {":32 regulator has none; expected exactly one of simulated, ascii_serial or modbus_tcp"}},
    {"safety: {",
     "safety: off  # {",
     {":34 safety is off; expected a map of commander_timeout_s, target_timeout_s, "
      "reading_timeout_s, slew_kpa_s, trip_margin_kpa, spike_time_s, min_supply_kpa, follow, "
      "leak_drop_kpa, fault_action, hold_time_s, vented_below_kpa or vent_time_s"}},
    {"      ring: {count: 3, radius_m: 0.03, tilt_deg: 10, length_scale: 1, contraction: muscle, "
     "max_pressure_kpa: "
     "300}\n",
     "",
     {":17 arm.sections[0] has none; expected exactly one of ring or actuators"}},
    {"separators: 5",
     "actuators: []",
     {":17 arm.sections[0] has ring and actuators; expected exactly one of ring or actuators"}},
    {"  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}\n",
     "",
     {":16 arm.sections[0].stiffness is missing; expected it here or in arm"}},
};
INSTANTIATE_TEST_SUITE_P(Keys, SpatialSceneRules, testing::ValuesIn(kKeys));

const BrokenRule kContractions[] = {
    {"[0.4, -0.1, 0, 0, 0, 0]",
     "[0.4, -0.1, 0]",
     {":5 contractions.muscle.quintic.coefficients_m has 3 entries; expected a list of 6 numbers, "
      "each a finite "
      "value"}},
    {"reference_pressure_kpa: 400",
     "reference_pressure_kpa: 0",
     {":6 contractions.muscle.quintic.reference_pressure_kpa is 0; expected a finite value > 0"}},
    {"      max_pressure_kpa: 400",
     "      max_pressure_kpa: low",
     {":7 contractions.muscle.quintic.max_pressure_kpa is low; expected a finite value > 0"}},
    {"pressure_kpa: [0, 50, 100]",
     "pressure_kpa: [-200, 50, 100]",
     {":9 contractions.bellows.table.pressure_kpa[0] is -200; expected -101.325 to 100000 kPa "
      "(gauge)"}},
    {"length_m: [0.1, 0.12, 0.13]",
     "length_m: [0.1, 0, 0.13]",
     {":9 contractions.bellows.table.length_m[1] is 0; expected a finite value > 0"}},
    {"length_m: 0.3",
     "length_m: 0",
     {":11 contractions.cable.tendon.length_m is 0; expected a finite value > 0"}},
    {"spool_radius_m: 0.01",
     "spool_radius_m: -1",
     {":11 contractions.cable.tendon.spool_radius_m is -1; expected a finite value > 0"}},
    {"max_angle_rad: 10",
     "max_angle_rad: 0",
     {":11 contractions.cable.tendon.max_angle_rad is 0; expected a finite value > 0"}},
    {"    quintic:",
     "    quintik:",
     {":4 contractions.muscle.quintik is not a known key; did you mean quintic?",
      ":3 contractions.muscle has none; expected exactly one of quintic, table or tendon"}},
    {"    tendon: {length_m: 0.3, spool_radius_m: 0.01, max_angle_rad: 10}",
     "    off",
     {":11 contractions.cable is off; expected a map of quintic, table, tendon or response"}},
    {"max_pressure_kpa: 300",
     "max_pressure_kpa: 401",
     {":18 arm.sections[0].ring.max_pressure_kpa is 401; expected a pressure that contraction "
      "muscle covers, 0 to "
      "400"}},
    {"min_pressure_kpa: 10",
     "min_pressure_kpa: -10",
     {":26 arm.sections[1].actuators[1].min_pressure_kpa is -10; expected a pressure that "
      "contraction bellows "
      "covers, 0 to 100"}},
    {"min_pressure_kpa: 10",
     "min_pressure_kpa: 90",
     {":26 arm.sections[1].actuators[1].min_pressure_kpa is 90; expected a minimum below the "
      "maximum"}},
    {"contraction: muscle,",
     "contraction: mussel,",
     {":18 arm.sections[0].ring.contraction is mussel; expected one of contractions: bellows, "
      "cable or muscle"}},
    {"contraction: muscle, max_pressure_kpa: 300",
     "contraction: cable, max_pressure_kpa: 300",
     {":18 arm.sections[0].ring.max_pressure_kpa limits a pressure, but contraction cable is a "
      "tendon; expected its "
      "max_angle_rad to be the limit"}},
};
INSTANTIATE_TEST_SUITE_P(Contractions, SpatialSceneRules, testing::ValuesIn(kContractions));

const BrokenRule kPoses[] = {
    {"position_m: [0, 0.02, 0]",
     "position_m: [0, 20, 0]",
     {":25 arm.sections[1].actuators[0].position_m[1] is 20; expected -10 to 10 m"}},
    {"position_m: [0, 0.02, 0]",
     "position_m: [0.1, 0.02, 0]",
     {":25 arm.sections[1].actuators[0].position_m has x = 0.1; expected 0, the cross-section"}},
    {"tilt_deg: 12",
     "tilt_deg: 12\n          rpy_deg: [0, 0, 0]",
     {":29 arm.sections[1].actuators[2].tilt_deg is 12; expected either tilt_deg or rpy_deg"}},
    {"position_m: [0, 0.01, 0.03]",
     "position_m: [0, 0, 0]",
     {":29 arm.sections[1].actuators[2].tilt_deg is 12; expected 0 at the centre, which has no "
      "outward side to tilt "
      "about"}},
    {"tilt_deg: 12",
     "tilt_deg: -100",
     {":29 arm.sections[1].actuators[2].tilt_deg is -100; expected an angle above -90 and below "
      "90"}},
};
INSTANTIATE_TEST_SUITE_P(Poses, SpatialSceneRules, testing::ValuesIn(kPoses));

const BrokenRule kPlane[] = {
    {"count: 2",
     "count: 3",
     {":10 arm.sections[0].ring.count is 3; expected 2, the number of muscles in the ring of a "
      "planar arm"}},
    {"radius_m: 0.03",
     "radius_m: 0.03, tilt_deg: 5",
     {":10 arm.sections[0].ring.tilt_deg is 5; expected 0: a planar arm has no tilt"}},
    {"ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: [{position_m: [0, 0.02, 0.01], contraction: muscle}]",
     {":10 arm.sections[0].actuators[0].position_m has z = 0.01; expected 0, the arm's plane"}},
    {"ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: [{position_m: [0, 0.02, 0], rpy_deg: [1, 0, 0], contraction: muscle}]",
     {":10 arm.sections[0].actuators[0].rpy_deg leaves the plane; expected roll and pitch 0 in a "
      "planar arm"}},
    {"ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: [{position_m: [0, 0.02, 0], tilt_deg: 1, contraction: muscle}]",
     {":10 arm.sections[0].actuators[0].tilt_deg is 1; expected 0: a planar arm has no tilt"}},
    {"ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: []",
     {":10 arm.sections[0].actuators is empty; expected a list of at least one entry"}},
    {"ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: {a: 1}",
     {":10 arm.sections[0].actuators is a map; expected a list of at least one entry"}},
    {"ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: [5]",
     {":10 arm.sections[0].actuators[0] is 5; expected a map of name, position_m, rpy_deg, "
      "tilt_deg, contraction, "
      "length_scale, stiffness, min_pressure_kpa or max_pressure_kpa"}},
    {"  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}\n  sections:\n    - name: only\n "
     "     ring: {count: "
     "2, radius_m: 0.03, contraction: muscle}",
     "  sections:\n    - name: only\n      actuators: [{position_m: [0, 0.02, 0], contraction: "
     "muscle}]",
     {":9 arm.sections[0].actuators[0].stiffness is missing; expected it here, in the section or "
      "in arm"}},
    {"contractions:\n  muscle:\n    table: {pressure_kpa: [0, 400], length_m: [0.4, 0.3]}\n",
     "",
     {":1 contractions is missing; expected a map of named contraction curves",
      ":7 arm.sections[0].ring.contraction is muscle; expected the name of a curve in "
      "contractions"}},
    {"  sections:\n    - name: only\n      ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "",
     {":5 arm.sections is missing; expected a list of at least one entry"}},
};
INSTANTIATE_TEST_SUITE_P(Plane, PlanarSceneRules, testing::ValuesIn(kPlane));

}  // namespace
}  // namespace helix_arm::io
