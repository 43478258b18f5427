// The command with foreign files and words: nothing waits, no content is printed, no memory is
// wasted, and the terminal obeys none of it.
#include <algorithm>
#include <fstream>

#include <gtest/gtest.h>
#include <sys/resource.h>

#include "command.hpp"
#include "helix_arm/basics/quote.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_size.hpp"

namespace helix_arm::test {
namespace {

constexpr rlim_t kMostMemory = 2ULL << 30U;  // of addresses; the libraries alone map a part of it

class HostileFiles : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    // Of this process, and of every command that it runs.
    const rlimit limit{kMostMemory, kMostMemory};
    ASSERT_EQ(setrlimit(RLIMIT_AS, &limit), 0);
  }

  std::string write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return folder_ / name;
  }

  // Every way to name a scene or a data set.
  std::vector<std::vector<std::string>> callsWith(const std::string& path) const {
    const std::string demo = scenePath("demo"), planar = scenePath("planar_76");
    return {{"forward", path, "--pressure-kpa", "0"},
            {"inverse", path, "--tip", "0.3,0,0"},
            {"evaluate", planar, path},
            {"fit", demo, path},
            {"calibrate", demo, path, "--out", folder_ / "out.yaml"},
            {"calibrate", path, path, "--out", folder_ / "out.yaml"},
            {"localize", path, path},
            {"workspace", path, "--out", folder_ / "out.ply"},
            {"regulator", path, "probe"},
            {"forward", planar, "--inputs", path},
            {"inverse", planar, "--targets", path},
            {"follow", demo, "--path", path, "--seconds", "1"}};
  }

  const TemporaryFolder folder_;
};

TEST_F(HostileFiles, NoCellOfATableIsRepeated) {
  for (const std::vector<std::string>& call : std::vector<std::vector<std::string>>{
           {"forward", scenePath("planar_76"), "--inputs",
            write("inputs.csv", "pressure_1_kpa\n77123.5\n")},
           {"inverse", scenePath("spatial_50"), "--targets",
            write("poses.csv", "x_m,y_m,z_m,qx,qy,qz,qw\n0.3,0,0,77123.5,0,0,0\n")}}) {
    const Outcome outcome = runCommand(call);
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_NE(outcome.err.find(".csv:2 "), std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find("77123"), std::string::npos) << outcome.err;
  }
}

// A result takes much more than its row.
TEST_F(HostileFiles, ResultsOfALongTableArePrintedAsTheyCome) {
  std::string rows = "pressure_1_kpa,pressure_2_kpa,pressure_3_kpa\n";
  for (int i = 0; i < 20'000; ++i) rows += "1,2,3\n";
  const Outcome outcome = runCommand({"forward", scenePath("spatial_50"), "--inputs",
                                      write("long.csv", rows), "--format", "json"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(outcome.json()["rows"].size(), 20'000u);
  rusage usage{};
  getrusage(RUSAGE_CHILDREN, &usage);
  EXPECT_LT(usage.ru_maxrss / 1024, 150) << "MB of the largest command; it was 220";
}

// What a terminal would obey: a title and a bell, a line that is overwritten, a forged line; and
// what passes a search for these: CSI of C1, a separator of lines, an override of the direction.
const std::string kControls = "\x1b]0;x\x07\rall is well\nerror: forged\x7f";
const std::string kUnseen = "\u009b31m\u2028error: forged\u202e\x9b";

void expectPlain(const Outcome& hostile, const Outcome& harmless, const std::string& what) {
  const auto lines = [](const std::string& text) {
    return std::count(text.begin(), text.end(), '\n');
  };
  for (const std::string& text : {hostile.out, hostile.err}) {
    EXPECT_EQ(text, basics::printableLines(text)) << what;
  }
  EXPECT_LE(lines(hostile.out), lines(harmless.out)) << what << hostile.out;
  EXPECT_LE(lines(hostile.err), std::max<std::ptrdiff_t>(1, lines(harmless.err)))
      << what << hostile.err;
}

// Each call with a word in the place of every @.
std::vector<std::string> filledIn(std::vector<std::string> call, const std::string& word) {
  for (std::string& argument : call) {
    for (std::size_t at; (at = argument.find('@')) != std::string::npos;) {
      argument.replace(at, 1, word);
    }
  }
  return call;
}

TEST_F(HostileFiles, NoArgumentReachesTheTerminalAsItIs) {
  const std::string demo = scenePath("demo");
  const std::string out = folder_ / "out.yaml", page = folder_ / "page.pdf";
  std::vector<std::vector<std::string>> calls = callsWith("@");
  for (const std::vector<std::string>& call : std::vector<std::vector<std::string>>{
           {"@"},
           {"--format", "@", "check", demo},
           {"--set", "@", "check", demo},
           {"--set", "arm.@=1", "check", demo},
           {"--set", "name=\"@\"", "check", demo},
           {"check", demo, "--@"},
           {"forward", demo, "--pressure-kpa", "@"},
           {"forward", demo, "--history", "@"},
           {"inverse", demo, "--tip", "0.3,0,0", "--prefer", "@"},
           {"calibrate", demo, demo, "--out", out, "--also", "@"},
           {"calibrate", demo, demo, "--out", out, "--fit", "@"},
           {"localize", demo, "@"},
           {"simulate", demo, "--count", "1", "--out", "/dev/null/@"},
           {"workspace", demo, "--png", "/dev/null/@"},
           {"path", "circle", "--out", "/dev/null/@"},
           {"follow", demo, "--tip", "0.3,0,0", "--seconds", "1", "--out", "/dev/null/@"},
           {"tags", "--board", "charuco", "--dictionary", "@", "--out", page},
           {"camera", "calibrate", "--source", "webcam", "--device", "@", "--seconds", "0.1"},
           {"new", "--defaults", "--out", out, "--host", "@"},
           {"regulator", demo, "@"}}) {
    calls.push_back(call);
  }
  int number = 0;
  for (const std::vector<std::string>& call : calls) {
    if (!test::isDrawn(number++, 3)) continue;
    const Outcome harmless = runCommand(filledIn(call, "word"));
    for (const std::string& word : {kControls, kUnseen}) {
      const Outcome hostile = runCommand(filledIn(call, word));
      std::string text;
      for (const std::string& argument : call) text += argument + " ";
      EXPECT_EQ(hostile.exit_code, harmless.exit_code == 1 && word == kUnseen ? 1 : 2) << text;
      expectPlain(hostile, harmless, text);
    }
  }
}

TEST_F(HostileFiles, NothingOfASceneReachesTheTerminalAsItIs) {
  const std::string arm = contentOf(scenePath("demo_serial"));
  const struct {
    std::string from, to;
  } kPlaces[] = {{"\narm:", "\n\"@\": 1\narm:"},
                 {"geometry: spatial", "geometry: \"@\""},
                 {"  geometry: spatial", "  \"@\": 1\n  \"@\": 2\n  geometry: spatial"},
                 {"name: demo_serial", "name: \"@\""},
                 {"  muscle:", "  \"@\":"},
                 {"profile: generic", "profile: \"@\""},
                 {"/tmp/helix_arm_regulator", "\"/tmp/@\""},
                 {"ascii_serial: {profile: generic, device: /tmp/helix_arm_regulator, "
                  "addresses: [\"0\", \"1\", \"2\"]}",
                  "modbus_tcp: {profile: festo_mpa, host: \"@\"}"}};
  // As YAML writes them between quotes.
  std::string controls;
  for (const char c : kControls) {
    constexpr char kDigits[] = "0123456789abcdef";
    const bool bare = c >= ' ' && c <= '~';
    controls += bare ? std::string(1, c) : std::string("\\x") + kDigits[c >> 4] + kDigits[c & 15];
  }
  int number = 0;
  for (const auto& [from, to] : kPlaces) {
    if (!test::isDrawn(number++, 3)) continue;
    ASSERT_NE(arm.find(from), std::string::npos) << from;
    const auto sceneWith = [&, from = from, to = to](const std::string& word) {
      std::string scene = arm;
      scene.replace(scene.find(from), from.size(), to);
      return write("scene.yaml", filledIn({scene}, word)[0]);
    };
    for (const std::vector<std::string>& call : std::vector<std::vector<std::string>>{
             {"check", "@"},
             {"regulator", "@", "probe"},
             {"regulator", "@", "emulate", "--seconds", "0.01"},
             {"regulator", "@", "set", "--pressure-kpa", "0,0,0"}}) {
      const Outcome harmless = runCommand(filledIn(call, sceneWith("word")));
      for (const std::string& word : {controls, kUnseen}) {
        const Outcome hostile = runCommand(filledIn(call, sceneWith(word)));
        EXPECT_EQ(hostile.exit_code, 2) << to;
        expectPlain(hostile, harmless, to);
      }
    }
  }
}

TEST_F(HostileFiles, NoColumnOfATableReachesTheTerminalAsItIs) {
  const auto tableWith = [this](const std::string& word) {
    return write("table.csv", "pressure_1_kpa," + word + ",\"" + word + "\"\n1," + word + ",3\n");
  };
  for (const std::vector<std::string>& call : callsWith("@")) {
    const Outcome harmless = runCommand(filledIn(call, tableWith("word")));
    expectPlain(runCommand(filledIn(call, tableWith(kUnseen))), harmless, call[0]);
  }
}

// Their names are repeated, one line each.
TEST_F(HostileFiles, NoNameOfAPictureReachesTheTerminalAsItIs) {
  for (const std::string& name : {kControls, kUnseen}) {
    TemporaryFolder pictures;
    std::ofstream(pictures / (name + ".png")) << "none";
    const Outcome text = runCommand({"localize", scenePath("demo"), pictures.path()});
    EXPECT_NE(text.out.find("forged"), std::string::npos) << text.out;
    EXPECT_EQ(text.out, basics::printableLines(text.out));
    EXPECT_EQ(text.out.find("\nerror: forged"), std::string::npos) << text.out;
    const Outcome place =
        runCommand({"camera", "place", scenePath("demo"), "--source", pictures.path()});
    EXPECT_EQ(place.err, basics::printableLines(place.err));
    EXPECT_EQ(place.err.find("\nerror: forged"), std::string::npos) << place.err;
  }
}

}  // namespace
}  // namespace helix_arm::test
