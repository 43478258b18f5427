// Which files services read.
#include <fstream>

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "ros_bridge/common/parameters.hpp"
#include "support/has.hpp"
#include "support/refusal.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::ros_bridge {
namespace {

namespace fs = std::filesystem;

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
}

}  // namespace
}  // namespace helix_arm::ros_bridge
