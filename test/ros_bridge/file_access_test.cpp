// Which files services read and write.
#include <fstream>

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "helix_arm/io/scene.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "support/has.hpp"
#include "support/refusal.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::ros_bridge {
namespace {

namespace fs = std::filesystem;

constexpr char kDemo[] = HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml";
constexpr char kCalibration[] = R"(
calibration:
  date: "2026-01-31T12:00:00Z"
  package_version: "0.1.0"
  from: arm.yaml
  data:
    - {file: a.csv, sha256: ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad, captures: 36}
  parameters:
    K_kappa: {value: 1.5e-4, standard_error: 2.0e-6, identifiable: true, unit: m^2}
  rms: 0.3
  error_unit: px
)";

class FileAccessTest : public ::testing::Test {
 protected:
  FileAccessTest() {
    fs::create_directories(inside_ / "deeper");
    fs::create_directories(outside_);
    for (const fs::path& folder : {inside_, inside_ / "deeper", outside_}) {
      write(folder / "data.csv", "a,b\n");
    }
  }

  static std::string write(const fs::path& path, const std::string& text) {
    std::ofstream(path) << text;
    return path.string();
  }
  // Why not; "accepted" where it is.
  std::string refusalToRead(const std::string& path) const {
    return test::refusal([&] { access().toRead("data", path, {".csv", ".bag"}); });
  }
  std::string refusalToWrite(const std::string& path) const {
    return test::refusal([&] { access().toWrite("out", path, {".yaml", ".csv"}); });
  }
  FileAccess access() const { return FileAccess({{inside_.string(), "~data_folder"}}); }

  const test::TemporaryFolder folder_;
  // The name of the one begins with that of the other.
  const fs::path inside_ = fs::canonical(folder_.path()) / "in";
  const fs::path outside_ = fs::canonical(folder_.path()) / "inside_not";
};

TEST_F(FileAccessTest, FilesBelowTheFolderAreRead) {
  for (const fs::path& path : {inside_ / "data.csv", inside_ / "deeper/data.csv",
                               inside_ / "deeper/../data.csv", inside_ / "./data.csv"}) {
    EXPECT_EQ(refusalToRead(path.string()), "accepted") << path;
  }
  fs::create_symlink(inside_ / "data.csv", inside_ / "link.csv");
  EXPECT_EQ(access().toRead("data", (inside_ / "link.csv").string(), {".csv"}),
            (inside_ / "data.csv").string());
}

TEST_F(FileAccessTest, NothingElseIs) {
  fs::create_symlink(outside_ / "data.csv", inside_ / "link.csv");
  fs::create_symlink(outside_, inside_ / "folder");
  ASSERT_EQ(mkfifo((inside_ / "fifo.csv").c_str(), 0600), 0);
  write(inside_ / "data.txt", "");
  fs::create_symlink(inside_ / "data.txt", inside_ / "text.csv");
  using namespace std::string_literals;
  for (const std::string& path :
       {(outside_ / "data.csv").string(), (inside_ / "../inside_not/data.csv").string(),
        (inside_ / "link.csv").string(), (inside_ / "folder/data.csv").string(),
        (inside_ / "text.csv").string(), (inside_ / "data.txt").string(), "data.csv"s, ""s,
        inside_.string(), "/etc/passwd"s, "/dev/zero"s,
        (inside_ / "data.csv").string() + '\0' + ".csv"}) {
    const std::string refusal = refusalToRead(path);
    EXPECT_EQ(refusal.find("data is '"), 0U) << path;
    EXPECT_TRUE(test::has(refusal, "; expected the absolute path of a .csv or .bag file below " +
                                       inside_.string() + " (~data_folder)"));
  }
  for (const char* name : {"fifo.csv", "none.csv"}) {
    EXPECT_TRUE(test::has(refusalToRead((inside_ / name).string()), "not a regular file"));
  }
  // Of what is elsewhere not even that it is there.
  const auto text = [&](const std::string& path) {
    std::string out = refusalToRead(path);
    return out.erase(out.find(path), path.size());
  };
  EXPECT_EQ(text((outside_ / "data.csv").string()), text((outside_ / "none.csv").string()));
}

TEST_F(FileAccessTest, NothingIsBelowAFolderThatCannotBeReached) {
  fs::create_symlink(inside_ / "loop", inside_ / "loop");
  const FileAccess access({{(inside_ / "loop").string(), "~data_folder"}});
  const std::string path = (outside_ / "data.csv").string();
  EXPECT_THROW(access.toRead("data", path, {".csv"}), std::invalid_argument);
  EXPECT_THROW(access.toWrite("out", (outside_ / "new.csv").string(), {".csv"}),
               std::invalid_argument);
}

TEST_F(FileAccessTest, NewFilesAndOursAreWritten) {
  EXPECT_EQ(refusalToWrite((inside_ / "new.yaml").string()), "accepted");
  EXPECT_EQ(refusalToWrite((inside_ / "deeper/new.csv").string()), "accepted");
  const std::string scene = io::sceneText(kDemo);
  EXPECT_EQ(refusalToWrite(write(inside_ / "calibrated.yaml", scene + kCalibration)), "accepted");
  EXPECT_EQ(refusalToWrite(write(inside_ / "samples.csv", "# recorded of scene demo, 2026\n")),
            "accepted");
  EXPECT_EQ(refusalToWrite(write(inside_ / "run.csv", "# recorded run of circle.csv, 2026\n")),
            "accepted");
}

TEST_F(FileAccessTest, NothingElseIsWrittenOver) {
  const std::string scene = io::sceneText(kDemo);
  fs::create_symlink(outside_ / "new.yaml", inside_ / "dangling.yaml");
  fs::create_symlink(inside_ / "new.yaml", inside_ / "dangling_inside.yaml");
  fs::create_directories(inside_ / "folder.yaml");
  ASSERT_EQ(mkfifo((inside_ / "fifo.yaml").c_str(), 0600), 0);
  for (const std::string& path :
       {write(inside_ / "hand_made.yaml", scene), write(inside_ / "notes.yaml", "a: 1\n"),
        write(inside_ / "short.csv", "# recorded"), write(inside_ / "empty.csv", ""),
        write(inside_ / "script.yaml", "#!/bin/sh\n"), write(inside_ / "empty.yaml", ""),
        (inside_ / "data.csv").string(), (inside_ / "dangling.yaml").string(),
        (inside_ / "dangling_inside.yaml").string(), (inside_ / "folder.yaml").string(),
        (inside_ / "fifo.yaml").string(), (inside_ / "none/new.yaml").string(),
        (inside_ / "authorized_keys").string(), (outside_ / "new.yaml").string()}) {
    EXPECT_EQ(refusalToWrite(path).find("out is '"), 0U) << path;
  }
}

}  // namespace
}  // namespace helix_arm::ros_bridge
