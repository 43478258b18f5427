// No callback of a node throws into roscpp, and no log line blocks the thread that logs.
#include "ros_bridge/common/guarded_callbacks.hpp"

#include <filesystem>
#include <regex>

#include <gtest/gtest.h>

#include "support/temporary_file.hpp"

namespace helix_arm::ros_bridge {
namespace {

TEST(FaultGuard, CatchesAnyExceptionAndReportsTheCulpritOnce) {
  std::vector<std::string> lines;
  FaultGuard guard("a message on /t", [&](const std::string& line) { lines.push_back(line); });
  std::string why;
  EXPECT_TRUE(guard.run(
      "/n", [] {}, &why));
  EXPECT_TRUE(lines.empty());
  EXPECT_FALSE(guard.run(
      "/n", [] { throw std::runtime_error("out of range"); }, &why));
  EXPECT_EQ(why, "out of range");
  EXPECT_FALSE(guard.run("/n", [] { throw 3; }));
  EXPECT_FALSE(guard.run("/n", [] { throw std::bad_alloc(); }));
  ASSERT_EQ(lines.size(), 1U);  // the others came within the period of the warnings
  EXPECT_EQ(lines[0], "a message on /t from /n was dropped (1 so far): out of range");
}

// Searches the sources of all nodes but one.
void expectNowhereBut(const char* exception, const std::string& pattern, const char* remedy) {
  const std::regex raw(pattern);
  int files = 0;
  for (const char* folder : {"/src/ros_bridge", "/src/nodes"}) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(
             std::string(HELIX_ARM_SOURCE_DIR) + folder)) {
      if (!entry.is_regular_file() || entry.path().filename() == exception) continue;
      EXPECT_FALSE(std::regex_search(test::contentOf(entry.path()), raw))
          << entry.path() << ": " << remedy;
      ++files;
    }
  }
  EXPECT_GT(files, 30);
}

TEST(GuardedCallbacks, NoNodeBypassesThem) {
  expectNowhereBut("guarded_callbacks.hpp", R"((subscribe|advertiseService|create\w*Timer)\s*[<(])",
                   "makes a callback by itself; see guarded_callbacks.hpp");
}

// rosconsole would block the thread that logs while the terminal is held up.
TEST(Log, NoNodeBypassesIt) {
  expectNowhereBut("diagnostics.cpp", R"(\bROS_(DEBUG|INFO|WARN|ERROR|FATAL|LOG)\w*\s*\()",
                   "logs in its own thread; see diagnostics.hpp");
}

}  // namespace
}  // namespace helix_arm::ros_bridge
