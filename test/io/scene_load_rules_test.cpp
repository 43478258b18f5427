// Every rule of a load and of tiers, broken once.

#include <gtest/gtest.h>

#include "scene_faults.hpp"

namespace helix_arm::io {
namespace {

using test::BrokenRule;
using test::BrokenValue;
using test::Faults;
using test::faultsOf;
using test::kLoadedScene;
using test::kPlanarScene;
using test::kSpatialScene;
using test::replaced;

const BrokenValue kLoadedValues[] = {
    {"load.", "gravity_m_s2: [0.1, 0.2, -9.7]", "-9.7", "a list of 3 numbers, each a finite value"},
    {"load.", "gravity_m_s2: [0.1, 0.2, -9.7]", "[0, 0, -9810]",
     "[2] is -9810; expected -1000 to 1000 m/s^2"},
    {"load.", "mass_kg: 0.3", "-0.3", "a finite value >= 0"},
    {"load.", "mass_kg: 0.3", "3000", "0 to 1000 kg"},
    {"load.", "mass_kg: 0.3", "[0.1, 0.1, 0.1]",
     " has 3 entries; expected a list of 2 numbers, each a finite value >= 0"},
    {"load.", "mass_kg: 0.3", "[0.1, heavy]", "[1] is heavy; expected a finite value >= 0"},
    {"load.tip.", "mass_kg: 0.05", ".nan", "a finite value >= 0"},
    {"load.tip.", "position_m: [0.02, 0, 0.01]", "[20, 0, 0.01]",
     "[0] is 20; expected -10 to 10 m"},
    {"load.tip.", "force_n: [0.1, 0.2, 0.3]", "[0.1, 0.2]",
     " has 2 entries; expected a list of 3 numbers, each a finite value"},
    {"load.tip.", "force_n: [0.1, 0.2, 0.3]", "[0.1, 0.2, 3e6]",
     "[2] is 3e6; expected -100000 to 100000 N"},
    {"load.tip.", "moment_nm: [0.01, 0, -0.02]", "[0.01, 0, big]",
     "[2] is big; expected a finite value"},
    {"load.points[0].", "s: 0.5, mass", "1.5, mass", " is 1.5; expected a number from 0 to 1"},
    {"load.points[0].", "mass_kg: 0.02", "-1", "a finite value >= 0"},
    {"arm.stiffness.", "K_eps_n: 900", "0", "a finite value > 0"},
    {"arm.stiffness.", "K_eps_n: 900", "1e12", "0.001 to 1000000000 N"},
    {"", "order: 3", "1", "a whole number from 2 to 8"},
    {"", "order: 3", "9", "a whole number from 2 to 8"},
    {"", "order: 3", "accuracy: {tip_error_percent: 0}",
     ".tip_error_percent is 0; expected a finite value > 0"},
    {"", "order: 3", "accuracy: {tip_error_percent: 200}",
     ".tip_error_percent is 200; expected 2e-07 to 100 % of the arm's length"},
    {"", "order: 3", "budget: {time_us: -1}", ".time_us is -1; expected a finite value > 0"},
    {"simulation.arm.", "K_eps_scale: 0.9", "0", "a finite value > 0"},
    {"load.points[0].", "section: upper, s: 0.5", "middle, s: 0.5",
     " is middle; expected lower or upper"},
    {"", "tier: loaded", "load", "auto, planar, linear, loaded or exact"},
    {"", "order: 3", "accuracy: 1", "a map of tip_error_percent"},
    {"", "order: 3", "accuracy: {}", ".tip_error_percent is missing; expected a finite value > 0"},
};

const BrokenRule kLoadedRules[] = {
    {"  mass_kg: 0.3\n",
     "",
     {":72 load.mass_kg is missing; expected the mass of the whole arm [kg], or a list of one "
      "number per section; 0 if it is negligible"}},
    {"  mass_kg: 0.3\n",
     "  mass_g: 300\n",
     {":74 load.mass_g is not a known key; did you mean mass_kg?",
      ":72 load.mass_kg is missing; expected the mass of the whole arm [kg], or a list of one "
      "number per section; 0 if it is negligible"}},
    {"  tip: {mass_kg: 0.05, position_m: [0.02, 0, 0.01], force_n: [0.1, 0.2, 0.3], moment_nm: "
     "[0.01, 0, -0.02]}",
     "  tip: {position_m: [0.02, 0, 0.01]}",
     {":75 load.tip has no effect; expected at least one of mass_kg, force_n and moment_nm"}},
    {"s: 0.25, force_n: [0, 0.5, 0]",
     "s: 0.25",
     {":78 load.points[1] has no effect; expected at least one of mass_kg, force_n and moment_nm"}},
    {"s: 0.25, ", "", {":78 load.points[1].s is missing; expected a number from 0 to 1"}},
    {"  points:\n",
     "  points: []\n  dots:\n",
     {":77 load.dots is not a known key; expected gravity_m_s2, mass_kg, tip or points",
      ":76 load.points is empty; expected a list of at least one entry"}},
    {", K_eps_n: 900",
     "",
     {":15 arm.stiffness.K_eps_n is missing; expected a finite value > 0 [N], the extensional "
      "stiffness of one actuator, which the key load needs; missing there and in their own "
      "stiffness: sections lower, upper"}},
    {"K_kappa_m2: 3.0e-4}",
     "K_kappa_m2: 3.0e-4, K_eps_n: 900}",
     {":31 arm.sections[1].actuators[2].stiffness.K_eps_n is that of one actuator; expected it in "
      "the stiffness of the section or of arm: K of a section is relative to one K_eps"}},
    {"tier: loaded",
     "tier: planar",
     {":79 tier is planar; expected auto, linear, loaded or exact, since arm.geometry is spatial",
      ":80 order applies to tier: loaded, but tier is planar; expected tier: loaded, or no order"}},
    {"tier: loaded\n",
     "",
     {":79 order applies to tier: loaded, but tier is auto; expected tier: loaded, or no order"}},
    {"order: 3",
     "accuracy: {tip_error_percent: 1}\nbudget: {time_us: 9}",
     {":81 budget is given together with accuracy; expected only one"}},
    {"order: 3",
     "order: 3\naccuracy: {tip_error_percent: 1}",
     {":81 accuracy has no effect, since tier is loaded with an order; expected tier: auto, or "
      "loaded without an order"}},
    {"tier: loaded\norder: 3",
     "tier: exact\nbudget: {time_us: 9}",
     {":80 budget has no effect, since tier is exact; expected tier: auto, or loaded without an "
      "order"}},
};

TEST(LoadedScene, BreakingARuleIsReported) {
  test::expectFaults(kLoadedScene, kLoadedValues);
  test::expectFaults(kLoadedScene, kLoadedRules);
}

TEST(LoadedScene, WithoutAnythingThatPullsIsRefused) {
  const std::string stiff =
      replaced(kPlanarScene, "K_kappa_m2: 1.0e-4}", "K_kappa_m2: 1.0e-4, K_eps_n: 900}");
  const std::string rule =
      "expected a mass > 0 [kg], or a mass, a force or a moment at the tip or at points: the load "
      "is zero; leave out the key load if that is intended";
  EXPECT_EQ(faultsOf(stiff + "load: {mass_kg: 0}\n"), Faults{":11 load.mass_kg is 0; " + rule});
  EXPECT_EQ(faultsOf(stiff + "load: {mass_kg: 0, tip: {mass_kg: 0}}\n"),
            Faults{":11 load.mass_kg is 0; " + rule});
  EXPECT_EQ(faultsOf(stiff + "load: {gravity_m_s2: [0, 0, -9.81]}\n"),
            Faults{":11 load.mass_kg is missing; expected the mass of the whole arm "
                   "[kg], or a list of one number per section; 0 if it is negligible"});
}

TEST(LoadedScene, OneSectionWithoutK_epsIsNamed) {
  const std::string text = replaced(replaced(kLoadedScene, ", K_eps_n: 900", ""),
                                    "K_kappa_m2: 2.0e-4}", "K_kappa_m2: 2.0e-4, K_eps_n: 700}");
  const std::vector<std::string> faults = faultsOf(text);
  ASSERT_EQ(faults.size(), 1u);
  EXPECT_EQ(faults[0].find(":15 arm.stiffness.K_eps_n is missing"), 0u) << faults[0];
  EXPECT_NE(faults[0].find("in their own stiffness: sections lower"), std::string::npos)
      << faults[0];
  EXPECT_EQ(faults[0].find("upper"), std::string::npos) << faults[0];
}

TEST(LoadedScene, TiersOfALoadNeedOne) {
  const std::vector<std::pair<std::string, std::string>> cases{
      {kSpatialScene + "tier: loaded\n",
       ":72 tier is loaded; expected auto or linear, since the scene has no key load; or add it"},
      {kSpatialScene + "tier: exact\n",
       ":72 tier is exact; expected auto or linear, since the scene has no key load; or add it"},
      {kPlanarScene + "tier: exact\n",
       ":11 tier is exact; expected auto, planar or linear, since the scene has no key load; or "
       "add it"},
  };
  for (const auto& [text, fault] : cases) {
    EXPECT_EQ(faultsOf(text), Faults{fault});
  }
}

TEST(LoadedScene, FaultsOfArmLoadAndTierAreReportedTogether) {
  std::string text = replaced(kLoadedScene, "radius_m: 0.03", "radius_m: -5");
  text = replaced(text, "mass_kg: 0.3", "mass_kg: -1");
  text = replaced(text, "order: 3", "order: 12");
  text = replaced(text, "commander_timeout_s: 0.8", "commander_timeout_s: -1");
  const std::vector<std::string> faults = faultsOf(text);
  const char* const starts[] = {":18 arm.sections[0].ring.radius_m", ":74 load.mass_kg",
                                ":80 order", ":34 safety.commander_timeout_s"};
  ASSERT_EQ(faults.size(), std::size(starts));
  for (std::size_t i = 0; i < faults.size(); ++i) {
    EXPECT_EQ(faults[i].find(starts[i]), 0u) << faults[i];
  }
}

}  // namespace
}  // namespace helix_arm::io
