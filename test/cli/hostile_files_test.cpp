// The command with paths of foreign files: nothing waits, no content is printed, no memory is
// wasted.
#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "command.hpp"
#include "support/temporary_folder.hpp"

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

TEST_F(HostileFiles, AFifoOrADeviceIsRefusedAtOnce) {
  const std::string fifo = folder_ / "fifo";
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);
  for (const std::vector<std::string>& call : callsWith(fifo)) {
    expectCallerError(runCommand(call), "is a FIFO; expected a regular file");
  }
  for (const std::vector<std::string>& call : callsWith("/dev/zero")) {
    expectCallerError(runCommand(call), "is a device; expected a regular file");
  }
  ASSERT_EQ(mkfifo((folder_ / "fifo.bag").c_str(), 0600), 0);
  expectCallerError(runCommand({"calibrate", scenePath("demo"), folder_ / "fifo.bag", "--out",
                                folder_ / "out.yaml"}),
                    "is a FIFO; expected a regular file");
}

TEST_F(HostileFiles, NothingIsRepeatedOfAFileOfSomebodyElse) {
  const std::string shadow = write("shadow",
                                   "root:$6$s3cretsalt$hashhash:19000:0:99999:7:::\n"
                                   "user:$6$s3cretsalt$hashhash:19000:0:99999:7:::\n");
  const std::string table = write("keys.csv", "s3cret,token\nhashhash,s3cret\n");
  const std::string keys = write("keys.yaml", "s3cret: hashhash\nname: s3cret\ntags: hashhash\n");
  for (const std::string& path : {shadow, table, keys}) {
    for (const std::vector<std::string>& call : callsWith(path)) {
      const Outcome outcome = runCommand(call);
      EXPECT_EQ(outcome.exit_code, 2);
      EXPECT_EQ(outcome.out, "");
      EXPECT_NE(outcome.err.find(path), std::string::npos) << outcome.err;
      EXPECT_EQ(outcome.err.find("s3cret"), std::string::npos) << outcome.err;
      EXPECT_EQ(outcome.err.find("hashhash"), std::string::npos) << outcome.err;
    }
  }
}

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

TEST_F(HostileFiles, WhatSwellsIsRefusedWithinTheMemoryThatThereIs) {
  const std::string name(5'000'000, 'n');
  for (const std::string& path :
       {write("name.csv", name + "\n" + name + "\n"), write("name.yaml", "name: " + name + "\n")}) {
    for (const std::vector<std::string>& call : callsWith(path)) {
      const Outcome outcome = runCommand(call);
      EXPECT_EQ(outcome.exit_code, 2);
      EXPECT_LT(outcome.err.size(), 10'000u) << outcome.err.substr(0, 1000);
      EXPECT_EQ(outcome.err.find("bad_alloc"), std::string::npos) << outcome.err;
    }
  }
  std::string rows = "pressure_1_kpa,pressure_2_kpa,curvature_rad\n";
  while (rows.size() < 16'000'000) rows += "0,0,0\n";
  expectCallerError(runCommand({"evaluate", scenePath("planar_76"), write("rows.csv", rows)}),
                    "expected at most 200000 rows");
}

// 32000 x 32000 px by its header: a gigabyte, were it decoded.
TEST_F(HostileFiles, APictureIsRefusedByItsHeader) {
  const char header[] = "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x7d\0\0\0\x7d\0\x01\0\0\0\0";
  const std::string path =
      write("large.png", std::string(header, sizeof header - 1) + std::string(124'000, 'x'));
  for (const bool has_camera : {true, false}) {
    const Outcome outcome = runCommand(
        {"localize", scenePath(has_camera ? "demo" : "helical_50"), path, "--format", "json"});
    EXPECT_EQ(outcome.exit_code, 1) << outcome.err;
    const auto frame = outcome.json()["frames"][0];
    EXPECT_EQ(frame["state"], has_camera ? "wrong_size" : "unreadable");
    EXPECT_NE(frame["reason"].get<std::string>().find("32000 x 32000"), std::string::npos) << frame;
  }
}

TEST_F(HostileFiles, ALinkToNothingIsNoPlaceForAResult) {
  std::filesystem::create_symlink(folder_ / "nothing.yaml", folder_ / "link.yaml");
  const std::string lengths =
      write("lengths.csv", "pressure_kpa,length_m\n0,0.4\n140,0.38\n280,0.36\n420,0.34\n");
  const Outcome outcome =
      runCommand({"calibrate", scenePath("planar_76"), lengths, "--fit", "contraction", "--curve",
                  "table", "--out", folder_ / "link.yaml"});
  EXPECT_EQ(outcome.exit_code, 2) << outcome.out;
  EXPECT_NE(outcome.err.find("is a link to a file that does not exist"), std::string::npos)
      << outcome.err;
  EXPECT_FALSE(std::filesystem::exists(folder_ / "nothing.yaml"));
  EXPECT_TRUE(std::filesystem::is_symlink(folder_ / "link.yaml"));
}

}  // namespace
}  // namespace helix_arm::test
