// Which scenes services read.
#include <filesystem>
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
      write(folder / "arm.yaml", "name: arm\n");
    }
  }

  static std::string write(const fs::path& path, const std::string& text) {
    std::ofstream(path) << text;
    return path.string();
  }
  // Why not; "accepted" where it is.
  std::string refusalToRead(const std::string& path) const {
    return test::refusal([&] { sceneBelow(folders_, path); });
  }

  const test::TemporaryFolder folder_;
  // The name of the one begins with that of the other.
  const fs::path inside_ = fs::canonical(folder_.path()) / "in";
  const fs::path outside_ = fs::canonical(folder_.path()) / "inside_not";
  const std::vector<SceneFolder> folders_{{inside_.string(), "~scene_folder"}};
};

TEST_F(FileAccessTest, FilesBelowTheFolderAreRead) {
  for (const fs::path& path : {inside_ / "arm.yaml", inside_ / "deeper/arm.yaml",
                               inside_ / "deeper/../arm.yaml", inside_ / "./arm.yaml"}) {
    EXPECT_EQ(refusalToRead(path.string()), "accepted") << path;
  }
  fs::create_symlink(inside_ / "arm.yaml", inside_ / "link.yaml");
  EXPECT_EQ(sceneBelow(folders_, (inside_ / "link.yaml").string()),
            (inside_ / "arm.yaml").string());
}

TEST_F(FileAccessTest, NothingElseIs) {
  fs::create_symlink(outside_ / "arm.yaml", inside_ / "link.yaml");
  fs::create_symlink(outside_, inside_ / "folder");
  ASSERT_EQ(mkfifo((inside_ / "fifo.yaml").c_str(), 0600), 0);
  write(inside_ / "arm.txt", "");
  fs::create_symlink(inside_ / "arm.txt", inside_ / "text.yaml");
  using namespace std::string_literals;
  for (const std::string& path :
       {(outside_ / "arm.yaml").string(), (inside_ / "../inside_not/arm.yaml").string(),
        (inside_ / "link.yaml").string(), (inside_ / "folder/arm.yaml").string(),
        (inside_ / "text.yaml").string(), (inside_ / "arm.txt").string(), "arm.yaml"s, ""s,
        inside_.string(), "/etc/passwd"s, "/dev/zero"s,
        (inside_ / "arm.yaml").string() + '\0' + ".yaml"}) {
    const std::string refusal = refusalToRead(path);
    EXPECT_EQ(refusal.find("scene is '"), 0U) << path;
    EXPECT_TRUE(test::has(refusal, "; expected the absolute path of a .yaml file below " +
                                       inside_.string() + " (~scene_folder)"));
  }
  for (const char* name : {"fifo.yaml", "none.yaml"}) {
    EXPECT_TRUE(test::has(refusalToRead((inside_ / name).string()), "not a regular file"));
  }
  // Of what is elsewhere not even that it is there.
  const auto text = [&](const std::string& path) {
    std::string out = refusalToRead(path);
    return out.erase(out.find(path), path.size());
  };
  EXPECT_EQ(text((outside_ / "arm.yaml").string()), text((outside_ / "none.yaml").string()));
}

}  // namespace
}  // namespace helix_arm::ros_bridge
