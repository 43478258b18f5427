// Every rule of the schema, broken once.

#include <gtest/gtest.h>

#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

using test::BrokenRule;
using test::BrokenValue;
using test::Faults;
using test::faultsOf;
using test::kPlanarScene;
using test::kSpatialScene;
using test::replaced;

const BrokenValue kSpatialValues[] = {
    {"arm.sections[0].ring.", "radius_m: 0.03", "-5", "a finite value > 0"},
    {"arm.sections[0].ring.", "radius_m: 0.03", ".nan", "a finite value > 0"},
    {"arm.sections[0].ring.", "radius_m: 0.03", "wide", "a finite value > 0"},
    {"arm.sections[0].ring.", "radius_m: 0.03", "\"0.03\"", "a finite value > 0"},
    {"arm.sections[0].ring.", "radius_m: 0.03", "[0.03]",
     " has 1 entries; expected one number, or a list of 2 to 9"},
    {"arm.sections[0].ring.", "radius_m: 0.03", "[0.03, -0.02]",
     "[1] is -0.02; expected a finite value > 0"},
    {"arm.sections[0].ring.", "radius_m: 0.03", "", " is empty; expected a finite value > 0"},
    {"arm.sections[0].ring.", "count: 3", "2.5", "a whole number from 1 to 24"},
    {"arm.sections[0].ring.", "count: 3", "25", "a whole number from 1 to 24"},
    {"arm.sections[0].ring.", "tilt_deg: 10", "90", "an angle above -90 and below 90"},
    {"arm.sections[0].ring.", "length_scale: 1", "0.4", "0.5 to 2"},
    {"arm.sections[0].ring.", "length_scale: 1", "[1, 1.01]",
     " has 2 entries; expected a list of 3 numbers, each a finite value > 0"},
    {"arm.sections[0].ring.", "length_scale: 1", "[1, 1.01, 3]", "[2] is 3; expected 0.5 to 2"},
    {"arm.sections[0].ring.", "length_scale: 1", "long", "a finite value > 0"},
    {"arm.sections[1].actuators[2].", "tilt_deg: 12", "length_scale: [1]",
     " is a list; expected a finite value > 0"},
    {"arm.sections[0].", "separators: 5", "1", "a whole number from 2 to 1000"},
    {"arm.sections[0].", "separator_radius_m: 0.04", "0", "a finite value > 0"},
    {"arm.sections[0].", "muscle_radius_m: 0.01", "-1", "a finite value > 0"},
    {"arm.stiffness.", "K_gamma: 10", "-1", "a finite value >= 0"},
    {"arm.stiffness.", "K_tau_m2: 0,", "inf,", " is inf; expected a finite value >= 0"},
    {"arm.stiffness.", "K_kappa_m2: 1.0e-4", "1e999", "a finite value >= 0"},
    {"arm.base.", "position_m: [0.1, 0.2, 1]", "[0.1, 0.2]",
     " has 2 entries; expected a list of 3 numbers, each a finite value"},
    {"arm.base.", "rpy_deg: [10, 90, 20]", "90", "a list of 3 numbers, each a finite value"},
    {"regulator.simulated.", "time_constant_s: 0.2", "0", "a finite value > 0"},
    {"regulator.simulated.", "time_constant_s: 0.2", "fall_time_constant_s: 0",
     "a finite value > 0"},
    {"regulator.simulated.", "time_constant_s: 0.2", "dead_time_s: 1.5", "0 to 1 s"},
    {"regulator.simulated.", "supply_kpa: 450", "-1", "a finite value > 0"},
    {"regulator.simulated.", "noise_kpa: 2", "-2", "a finite value >= 0"},
    {"regulator.simulated.", "seed: 7", "4294967296", "a whole number from 0 to 4294967295"},
    {"safety.", "commander_timeout_s: 0.8", "0", "a finite value > 0"},
    {"arm.", "geometry: spatial", "flat", "planar or spatial"},
    {"", "name: rig", "my rig", "a word of letters, digits, _ and -"},
    {"arm.sections[0].", "name: lower", "[a]",
     " is a list; expected a word of letters, digits, _ and -"},
    {"arm.sections[1].", "name: upper", "lower", "a name that no other section has"},
    {"arm.sections[1].actuators[2].", "name: top", "left",
     " makes a second actuator named left; expected distinct names"},
    {"arm.sections[1].actuators[2].", "name: top", "muscle_2",
     " makes a second actuator named muscle_2; expected distinct names"},
    {"", "safety: {", "off  # {",
     " is off; expected a map of commander_timeout_s, target_timeout_s, reading_timeout_s, "
     "slew_kpa_s, trip_margin_kpa, spike_time_s, min_supply_kpa, follow, leak_drop_kpa, "
     "fault_action, hold_time_s, vented_below_kpa or vent_time_s"},
    {"contractions.muscle.quintic.", "coefficients_m: [0.4, -0.1, 0, 0, 0, 0]", "[0.4, -0.1, 0]",
     " has 3 entries; expected a list of 6 numbers, each a finite value"},
    {"contractions.muscle.quintic.", "reference_pressure_kpa: 400", "0", "a finite value > 0"},
    {"contractions.bellows.table.", "pressure_kpa: [0, 50, 100]", "[-200, 50, 100]",
     "[0] is -200; expected -101.325 to 100000 kPa (gauge)"},
    {"contractions.bellows.table.", "length_m: [0.1, 0.12, 0.13]", "[0.1, 0, 0.13]",
     "[1] is 0; expected a finite value > 0"},
    {"contractions.cable.tendon.", "length_m: 0.3", "0", "a finite value > 0"},
    {"contractions.cable.tendon.", "spool_radius_m: 0.01", "-1", "a finite value > 0"},
    {"contractions.cable.tendon.", "max_angle_rad: 10", "0", "a finite value > 0"},
    {"arm.sections[0].ring.", "max_pressure_kpa: 300", "401",
     "a pressure that contraction muscle covers, 0 to 400"},
    {"arm.sections[1].actuators[1].", "min_pressure_kpa: 10", "-10",
     "a pressure that contraction bellows covers, 0 to 100"},
    {"arm.sections[1].actuators[1].", "min_pressure_kpa: 10", "90", "a minimum below the maximum"},
    {"arm.sections[0].ring.", "contraction: muscle,", "mussel,",
     " is mussel; expected one of contractions: bellows, cable or muscle"},
    {"arm.sections[1].actuators[0].", "position_m: [0, 0.02, 0]", "[0, 20, 0]",
     "[1] is 20; expected -10 to 10 m"},
    {"arm.sections[1].actuators[0].", "position_m: [0, 0.02, 0]", "[0.1, 0.02, 0]",
     " has x = 0.1; expected 0, the cross-section"},
    {"arm.sections[1].actuators[2].", "tilt_deg: 12", "12\n          rpy_deg: [0, 0, 0]",
     " is 12; expected either tilt_deg or rpy_deg"},
    {"arm.sections[1].actuators[2].", "tilt_deg: 12", "-100", "an angle above -90 and below 90"},
};

const BrokenRule kSpatialRules[] = {
    {"radius_m: 0.03, tilt_deg: 10",
     "radius_m: [0.03, 0.02], tilt_deg: [10, 5, 0]",
     {":18 arm.sections[0].ring.tilt_deg has 3 values; expected 2, as many as radius_m, or one "
      "number"}},
    {"[10, 90, 20]",
     "[10, .inf, up]",
     {":14 arm.base.rpy_deg[1] is .inf; expected a finite value",
      ":14 arm.base.rpy_deg[2] is up; expected a finite value"}},
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
    {"name: rig\n", "", {":1 name is missing; expected a word of letters, digits, _ and -"}},
    {"    - name: lower\n      ring",
     "    - ring",
     {":17 arm.sections[0].name is missing; expected a word of letters, digits, _ and -"}},
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
    {"      ring: {count: 3, radius_m: 0.03, tilt_deg: 10, length_scale: 1, contraction: muscle, "
     "max_pressure_kpa: 300}\n",
     "",
     {":17 arm.sections[0] has none; expected exactly one of ring or actuators"}},
    {"separators: 5",
     "actuators: []",
     {":17 arm.sections[0] has ring and actuators; expected exactly one of ring or actuators"}},
    {"  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}\n",
     "",
     {":16 arm.sections[0].stiffness is missing; expected it here or in arm"}},
    {"      max_pressure_kpa: 400",
     "      max_pressure_kpa: low",
     {":7 contractions.muscle.quintic.max_pressure_kpa is low; expected a finite value > 0"}},
    {"    quintic:",
     "    quintik:",
     {":4 contractions.muscle.quintik is not a known key; did you mean quintic?",
      ":3 contractions.muscle has none; expected exactly one of quintic, table or tendon"}},
    {"    tendon: {length_m: 0.3, spool_radius_m: 0.01, max_angle_rad: 10}",
     "    off",
     {":11 contractions.cable is off; expected a map of quintic, table, tendon or response"}},
    {"contraction: muscle, max_pressure_kpa: 300",
     "contraction: cable, max_pressure_kpa: 300",
     {":18 arm.sections[0].ring.max_pressure_kpa limits a pressure, but contraction cable is a "
      "tendon; expected its max_angle_rad to be the limit"}},
    {"position_m: [0, 0.01, 0.03]",
     "position_m: [0, 0, 0]",
     {":29 arm.sections[1].actuators[2].tilt_deg is 12; expected 0 at the centre, which has no "
      "outward side to tilt about"}},
};

TEST(SceneRules, BreakingOneIsReported) {
  test::expectFaults(kSpatialScene, kSpatialValues);
  test::expectFaults(kSpatialScene, kSpatialRules);
}

const BrokenValue kPlanarValues[] = {
    {"arm.sections[0].ring.", "count: 2", "3",
     "2, the number of muscles in the ring of a planar arm"},
    {"arm.sections[0].", "ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: [{position_m: [0, 0.02, 0.01], contraction: muscle}]",
     "[0].position_m has z = 0.01; expected 0, the arm's plane"},
    {"arm.sections[0].", "ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: [{position_m: [0, 0.02, 0], rpy_deg: [1, 0, 0], contraction: muscle}]",
     "[0].rpy_deg leaves the plane; expected roll and pitch 0 in a planar arm"},
    {"arm.sections[0].", "ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: [{position_m: [0, 0.02, 0], tilt_deg: 1, contraction: muscle}]",
     "[0].tilt_deg is 1; expected 0: a planar arm has no tilt"},
    {"arm.sections[0].", "ring: {count: 2, radius_m: 0.03, contraction: muscle}", "actuators: []",
     " is empty; expected a list of at least one entry"},
    {"arm.sections[0].", "ring: {count: 2, radius_m: 0.03, contraction: muscle}",
     "actuators: {a: 1}", " is a map; expected a list of at least one entry"},
    {"arm.sections[0].", "ring: {count: 2, radius_m: 0.03, contraction: muscle}", "actuators: [5]",
     "[0] is 5; expected a map of name, position_m, rpy_deg, tilt_deg, contraction, length_scale, "
     "stiffness, min_pressure_kpa or max_pressure_kpa"},
};

const BrokenRule kPlanarRules[] = {
    {"radius_m: 0.03",
     "radius_m: 0.03, tilt_deg: 5",
     {":10 arm.sections[0].ring.tilt_deg is 5; expected 0: a planar arm has no tilt"}},
    {"  stiffness: {K_gamma: 10, K_tau_m2: 0, K_kappa_m2: 1.0e-4}\n  sections:\n    - name: only\n "
     "     ring: {count: 2, radius_m: 0.03, contraction: muscle}",
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

TEST(SceneRules, BreakingOneOfAPlanarArmIsReported) {
  test::expectFaults(kPlanarScene, kPlanarValues);
  test::expectFaults(kPlanarScene, kPlanarRules);
}

// A response of the bellows, and what is said of it.
const std::pair<const char*, const char*> kResponses[] = {
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
TEST(SceneResponse, BreakingARuleIsReported) {
  const std::string curve = "length_m: [0.1, 0.12, 0.13]}\n";
  const auto with = [&](const std::string& response) {
    return faultsOf(replaced(kSpatialScene, curve, curve + "    response: " + response + "\n"));
  };
  EXPECT_EQ(with("{}"), Faults());
  EXPECT_EQ(with("{play_kpa: [20, 60], play_weight: [0.3, 0.65]}"), Faults());
  for (const auto& [response, fault] : kResponses) {
    EXPECT_EQ(with(response), Faults{std::string(":10 contractions.bellows.response") + fault});
  }
}

TEST(SceneResponse, ATendonHasNone) {
  const std::string tendon = "    tendon: {length_m: 0.3";
  EXPECT_EQ(
      faultsOf(
          replaced(kSpatialScene, tendon, "    response: {rise_time_constant_s: 1}\n" + tendon)),
      Faults{":11 contractions.cable.response is given for a tendon, which follows its spool; "
             "expected it only where the input is a pressure"});
}

}  // namespace
}  // namespace helix_arm::io
