// Calibrations of the response: readings in the order taken.

#include <sstream>

#include <gtest/gtest.h>

#include "command.hpp"
#include "helix_arm/model/response.hpp"
#include "support/random.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

constexpr double kMost = 413.6856;  // [kPa], the limit of the scene's muscles
constexpr double kNoise = 2e-4;     // of free lengths [m]

// Pressures that rise and fall, with turns inside the loop [kPa].
std::vector<double> cycles() {
  std::vector<double> out{0};
  const auto go = [&out](double to) {
    const double from = out.back(), step = to > from ? 20 : -20;
    for (double p = from + step; (to - p) * step > 0; p += step) out.push_back(p);
    out.push_back(to);
  };
  for (const double to : {kMost, 0.0, 250.0, 100.0, kMost, 200.0, 300.0, 0.0}) go(to);
  return out;
}

// Of a muscle with a play of 40 kPa.
std::string freeLengths() {
  Random random(3);
  model::Response truth;
  truth.play_count = 1;
  truth.plays[0] = {40e3, 0.6};
  model::ResponseState state(truth);
  std::ostringstream rows;
  rows.precision(12);
  rows << "pressure_kpa,length_m\n";
  for (const double kpa : cycles()) {
    state.step(1e3 * kpa, HUGE_VAL);
    const double u = state.effective() / (1e3 * kMost);
    const double length = 0.443 - 0.09 * u * (0.6 + 1.2 * u - 0.8 * u * u);
    rows << kpa << "," << length + kNoise * random.normal() << "\n";
  }
  return rows.str();
}

Outcome calibrate(const std::string& scene, const std::vector<std::string>& data,
                  const std::vector<std::string>& more) {
  std::vector<std::string> arguments{"calibrate", scene, "--format", "json"};
  arguments.insert(arguments.end(), data.begin(), data.end());
  return runCommand(arguments, more);
}

void expectWithin(const json& estimate, double truth, double most) {
  EXPECT_NEAR(estimate["value"].get<double>(), truth, most);
  EXPECT_NEAR(estimate["value"].get<double>(), truth, 3 * estimate["standard_error"].get<double>());
}

TEST(CalibrateResponse, FreeLengthsUpAndDownGiveCurveAndPlay) {
  const TemporaryFolder folder;
  const TemporaryFile data(freeLengths());
  const std::string out = folder / "calibrated.yaml";
  const Outcome outcome = calibrate(scenePath("planar_76"), {data.path()},
                                    {"--fit", "contraction,response", "--out", out});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err << outcome.out;
  const json response = outcome.json()["response"];
  EXPECT_EQ(response["contractions"], json({"planar_muscle"}));
  EXPECT_EQ(response["play"]["verdict"], "found");
  ASSERT_EQ(response["play_kpa"].size(), 1u) << response;
  expectWithin(response["play_kpa"][0], 40, 4);
  expectWithin(response["play_weight"][0], 0.6, 0.06);
  EXPECT_EQ(response["lag"]["verdict"], "not_determined");
  EXPECT_GT(response["static_rms_m"].get<double>(), 10 * kNoise);
  EXPECT_LT(response["rms_m"].get<double>(), 1.3 * kNoise);
  EXPECT_NE(contentOf(out).find("play_kpa"), std::string::npos) << contentOf(out);
  EXPECT_EQ(runCommand({"check", out}).exit_code, 0);
}

}  // namespace
}  // namespace helix_arm::test
