// helix_arm plan, and the other commands where zones are.
#include <fstream>

#include <gtest/gtest.h>

#include "command.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::test {
namespace {

using nlohmann::json;

constexpr char kTouches[] = "0,150,150";  // [kPa]

// --set of a post at the demo's tip at kTouches, with a thin arm; its base looks down from 0.6 m.
std::vector<std::string> withPost() {
  const json tip = resultOf({"forward", "demo", "--pressure-kpa", kTouches})["tip"]["position_m"];
  const std::string place = json({tip[2], tip[1], 0.6 - tip[0].get<double>()}).dump();
  return {"--set", "arm.sections.0.separator_radius_m=0.01",
          "--set", "clearance_m=0.005",
          "--set", "keep_out=[{name: post, sphere: {radius_m: 0.005, position_m: " + place + "}}]"};
}

TEST(PlanCommand, FindsATableOfPressuresThatIsClear) {
  const TemporaryFolder folder;
  const std::string out = folder / "around.csv";
  const std::vector<std::string> post = withPost();
  const std::vector<std::string> call{"plan",      "demo",  "--from-kpa", "0,300,0",  "--to-kpa",
                                      "400,0,100", "--out", out,          "--format", "json"};
  const Outcome ran = runCommand(call, post);
  ASSERT_EQ(ran.exit_code, 0) << ran.err << ran.out;
  const json found = ran.json();
  EXPECT_TRUE(found["found"]);
  EXPECT_TRUE(found["reason"].is_null());
  EXPECT_EQ(found["zone"], "post");
  EXPECT_GE(found["clearance_m"], 0.0049);
  // The table's rows, by `forward`, keep away, too; pressures and tips are read as other tables.
  const Outcome rows = runCommand({"forward", "demo", "--inputs", out, "--format", "json"}, post);
  ASSERT_EQ(rows.exit_code, 0) << rows.err;
  const json table = rows.json()["rows"];
  ASSERT_EQ(table.size(), found["rows"].size());
  for (std::size_t i = 0; i < found["rows"].size(); ++i) {
    const json& row = table[i];
    EXPECT_NEAR(row["clearance_m"].get<double>(), found["rows"][i]["clearance_m"].get<double>(),
                1e-4);
    EXPECT_EQ(row["zone"], "post");
  }
  const json path =
      runCommand({"follow", "demo", "--path", out, "--open", "--format", "json"}, post).json();
  EXPECT_LT(path["path_rms_m"], 0.05);
  const json again = runCommand(call, post).json();
  EXPECT_EQ(again["rows"], found["rows"]);
}

TEST(PlanCommand, ARegulatorIsNotSetToWhatWouldTouch) {
  expectCallerError(
      runCommand({"regulator", "demo", "set", "--pressure-kpa", kTouches}, withPost()), "post");
}

// A path of which two points are clear, and the way between them is not.
TEST(PlanCommand, AFollowedPathIsSwept) {
  const TemporaryFolder folder;
  const std::string path = folder / "path.csv";
  std::ofstream file(path);
  file << "time_s,x_m,y_m,z_m\n";
  double time = 0;
  for (const char* pressures : {"0,0,0", kTouches, "0,0,0"}) {
    const json tip =
        resultOf({"forward", "demo", "--pressure-kpa", pressures})["tip"]["position_m"];
    file << time << "," << commaList(numbersOf(tip)) << "\n";
    time += 20;
  }
  file.close();
  const Outcome blocked = runCommand({"follow", "demo", "--path", path, "--open"}, withPost());
  EXPECT_NE(blocked.exit_code, 0);
  EXPECT_TRUE(has(blocked.err + blocked.out, "post")) << blocked.err << blocked.out;
}

}  // namespace
}  // namespace helix_arm::test
