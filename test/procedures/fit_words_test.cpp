#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/basics/text.hpp"
#include "helix_arm/calibration/calibration_parameters.hpp"
#include "support/has.hpp"
#include "support/refusal.hpp"

namespace helix_arm::test {
namespace {

using namespace estimation;
using Parameters = std::set<FitParameter>;

std::string contentOf(const std::string& name) {
  std::ifstream file(std::string(HELIX_ARM_SOURCE_DIR) + "/" + name);
  EXPECT_TRUE(file) << name;
  return {std::istreambuf_iterator<char>(file), {}};
}

// The comment of a field of a message, over as many lines as it has, with single spaces.
std::string commentOf(const std::string& file, const std::string& field) {
  std::istringstream lines(contentOf(file));
  std::string text;
  bool inside = false;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t hash = line.find('#');
    const std::string code = line.substr(0, hash);
    if (code.find_first_not_of(' ') != std::string::npos) {
      std::istringstream words(code);
      std::string type, name;
      words >> type >> name;
      inside = name == field;
    }
    if (inside && hash != std::string::npos) text += line.substr(hash + 1);
  }
  std::istringstream words(text);
  text.clear();
  for (std::string word; words >> word;) text += (text.empty() ? "" : " ") + word;
  return text;
}

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

TEST(FitParameters, OptionsHoldWhatWasSet) {
  for (const FitParameterInfo& info : estimation::fitParameters()) {
    CalibrationOptions options;
    estimation::setFitted({info.parameter}, options);
    for (const FitParameterInfo& other : estimation::fitParameters()) {
      const bool set = info.block && other.parameter == info.parameter;
      EXPECT_EQ(isFitted(other, options), set) << info.word << ": " << other.word;
    }
  }
}

TEST(FitParameters, PriorsArePositive) {
  for (const FitParameterInfo& info : estimation::fitParameters()) {
    for (const estimation::FitNumber& number : info.numbers) {
      EXPECT_GT(number.prior.deviation({}), 0) << info.word << number.suffix;
    }
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
            (Parameters{FitParameter::kBase, FitParameter::kTags, FitParameter::kBleed}));
  EXPECT_EQ(of({"placement"}, false), (Parameters{FitParameter::kBase, FitParameter::kTags}));
  EXPECT_EQ(of({"bleed"}, false), Parameters{FitParameter::kBleed}) << "asked for by itself";
}

TEST(FitWords, OfNoParameterAreRefused) {
  EXPECT_EQ(refusal([] {
              estimation::fitParametersOf({"tags", "springs"}, false);
            }),
            "\"springs\" is not a parameter to fit; expected some of " +
                basics::joined(estimation::fitWords()));
}

TEST(FitWords, EachActuatorsScaleGoesBeforeTheCommonOne) {
  CalibrationOptions options;
  estimation::setFitted({FitParameter::kLengthScale, FitParameter::kLengthScaleEach}, options);
  EXPECT_EQ(options.length_scale, LengthScaling::kEach);
  EXPECT_FALSE(options.K_kappa) << "only what was named is fitted";
}

TEST(FitWords, TheServiceAndTheActionSayWhatIsFittedByDefault) {
  const std::string by_default =
      "; empty: " + std::string(estimation::wordOf(estimation::kDefaultFitGroup));
  for (const char* file : {"srv/Calibrate.srv", "action/RunCalibration.action"}) {
    EXPECT_TRUE(has(commentOf(file, "fit"), by_default)) << file;
  }
}

TEST(FitWords, AreInTheDocumentation) {
  for (const std::string& word : estimation::fitWords()) {
    EXPECT_TRUE(has(contentOf("docs/calibration.md"), "`" + word + "`")) << word;
  }
}

}  // namespace
}  // namespace helix_arm::test
