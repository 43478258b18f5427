#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/calibration/calibration_parameters.hpp"
#include "procedures/calibration_job.hpp"

namespace helix_arm::test {
namespace {

using namespace estimation;
using namespace procedures;
using Parameters = std::set<FitParameter>;

TEST(FitParameters, EveryParameterHasItsRow) {
  const std::vector<FitParameterInfo>& table = estimation::fitParameters();
  ASSERT_EQ(table.size(), static_cast<std::size_t>(estimation::kFitParameterCount));
  std::set<std::string> words;
  for (std::size_t i = 0; i < table.size(); ++i) {
    EXPECT_EQ(table[i].parameter, static_cast<FitParameter>(i)) << table[i].word;
    EXPECT_EQ(table[i].numbers.empty(), !table[i].block) << table[i].word;
    EXPECT_TRUE(words.insert(table[i].word).second) << table[i].word;
  }
}

TEST(FitWords, NameParametersAndGroups) {
  const auto of = &estimation::fitParametersOf;
  const Parameters stiffness{FitParameter::kKappa, FitParameter::kGamma};
  EXPECT_EQ(of({}, false), stiffness);
  EXPECT_EQ(of({"stiffness"}, true), stiffness);
  EXPECT_EQ(of({"K_tau", "length_scale"}, false),
            (Parameters{FitParameter::kTau, FitParameter::kLengthScale}));
  EXPECT_EQ(of({"placement"}, true),
            (Parameters{FitParameter::kBase, FitParameter::kTags, FitParameter::kBorderShift}));
  EXPECT_EQ(of({"placement"}, false), (Parameters{FitParameter::kBase, FitParameter::kTags}));
  EXPECT_EQ(of({"bleed"}, false), Parameters{FitParameter::kBorderShift}) << "asked for by itself";
}

// ---- Results in words ---------------------------------------------------------------------------

CalibrationOutcome outcome() {
  CalibrationOutcome out;
  out.success = true;
  out.tip_error_before = 0.01432;
  out.tip_error_after = 0.00098;
  estimation::Calibration calibration;
  calibration.parameters = {
      {"K_gamma", "", 100, 61.6593, 9.22846, true},
      {"K_kappa", "m^2", 9.8e-5, 9.8e-5, 1.078e-4, false},
      {"length_scale", "", 1, 1.00916, 0.00189865, true},
      {"base_x", "m", 0, 8.2e-5, 2.3e-4, true},
      {"base_rx", "rad", 0, 3.5e-4, 1.2e-3, true},
      {"tag_13_along", "m", 0, 1.5e-4, 6.1e-4, true},
      {"tag_13_y", "m", 0, 3.1e-5, 1.6e-3, false},
      {"tag_4_along", "m", 0, 0, 2e-3, false},
      {"tag_2_rz", "rad", 0, 4.8e-4, 1.5e-3, true},
  };
  out.calibration = calibration;
  return out;
}

TEST(CalibrationWords, WhatWasNotDeterminedIsLeftOut) {
  const Determined found = determinedOf(outcome());
  ASSERT_EQ(found.parameters.size(), 4u);
  EXPECT_EQ(found.parameters[1].name, "length_scale");
  EXPECT_EQ(found.tags, (std::vector<int>{2, 13}));
  EXPECT_EQ(found.omitted, 3);
}

TEST(CalibrationWords, AValueHasTheDigitsThatItsErrorLeaves) {
  EXPECT_EQ(textOf({"K_gamma", "", 100, 61.6593, 9.22846, true}), "K_gamma = 61.7 +- 9.2");
  EXPECT_EQ(textOf({"length_scale", "", 1, 1.00916, 0.00189865, true}),
            "length_scale = 1.0092 +- 0.0019");
  EXPECT_EQ(textOf({"K_kappa", "m^2", 0, 1.17012e-4, 2.1e-6, true}),
            "K_kappa = 0.000117 +- 2.1e-06 m^2");
  EXPECT_EQ(textOf({"base_x", "m", 0, 0, 0.002, true}), "base_x = 0 +- 0.002 m");
  EXPECT_EQ(textOf({"K_gamma", "", 100, 61.6593, 0, true}), "K_gamma = 61.6593 +- 0");
}

}  // namespace
}  // namespace helix_arm::test
