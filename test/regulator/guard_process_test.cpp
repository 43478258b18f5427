#include "helix_arm/regulator/guard_process.hpp"

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/eventually.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::regulator {
namespace {

namespace fs = std::filesystem;

// A guard that answers, and notes what it was told, beats aside, until its input ended.
class Noting : public ::testing::Test {
 protected:
  std::string told() const {
    std::ostringstream text;
    text << std::ifstream(note()).rdbuf();
    std::string words = text.str();
    words.erase(std::remove(words.begin(), words.end(), GuardProcess::kBeat), words.end());
    return words;
  }
  std::uintmax_t beats() const { return fs::exists(note()) ? fs::file_size(note()) : 0; }
  std::string note() const { return folder_ / "told"; }
  std::string done() const { return folder_ / "done"; }
  std::vector<std::string> command() const {
    return {"/bin/sh", "-c", "tee \"$0\" >&0 2>/dev/null; : > \"$1\"", note(), done()};
  }
  // The same in one process, whose number is in done().
  std::vector<std::string> single() const {
    return {"/bin/sh", "-c", "echo $$ > \"$1\"; exec tee \"$0\" >&0 2>/dev/null", note(), done()};
  }
  pid_t numberOfSingle() const {
    pid_t number = 0;
    std::ifstream(done()) >> number;
    return number;
  }

  test::TemporaryFolder folder_;
};

TEST_F(Noting, IsDismissedAtAnOrderlyEnd) {
  {
    GuardProcess guard(command());
    EXPECT_TRUE(guard.stands());
    guard.dismiss();
    EXPECT_FALSE(guard.stands());
  }
  EXPECT_TRUE(test::eventually([&] { return fs::exists(done()); }));
  EXPECT_EQ(told(), std::string(1, GuardProcess::kDismissal));
}

TEST_F(Noting, IsLeftToItsTaskWhereNobodyDismissesIt) {
  { const GuardProcess guard(command()); }
  EXPECT_TRUE(test::eventually([&] { return fs::exists(done()); }));
  EXPECT_EQ(told(), "");
}

TEST_F(Noting, OutlivesAKilledProcessGroupAndHearsOfIt) {
  const pid_t ward = fork();
  if (ward == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    setpgid(0, 0);
    const GuardProcess guard(command());
    while (true) pause();
  }
  setpgid(ward, ward);
  ASSERT_TRUE(test::eventually([&] { return fs::exists(note()); }));
  EXPECT_FALSE(fs::exists(done()));
  ASSERT_EQ(kill(-ward, SIGKILL), 0);
  int status = 0;
  ASSERT_EQ(waitpid(ward, &status, 0), ward);
  ASSERT_TRUE(WIFSIGNALED(status));
  EXPECT_TRUE(test::eventually([&] { return fs::exists(done()); }));
  EXPECT_EQ(told(), "");
}

TEST_F(Noting, HearsABeatWithoutAnybodysDoing) {
  const GuardProcess guard(command());
  EXPECT_TRUE(test::eventually([&] { return beats() >= 3; }));
  EXPECT_EQ(told(), "");
}

TEST_F(Noting, ThatHasEndedNoLongerStands) {
  GuardProcess guard({"/bin/true"});
  EXPECT_TRUE(test::eventually([&] { return !guard.stands(); }));
}

TEST_F(Noting, ThatIsStoppedNoLongerStandsUntilItWakesUp) {
  GuardProcess guard(single());
  ASSERT_TRUE(test::eventually([&] { return beats() >= 3; }));
  EXPECT_TRUE(test::eventually([&] { return guard.stands(); }));
  ASSERT_EQ(kill(numberOfSingle(), SIGSTOP), 0);
  EXPECT_TRUE(test::eventually([&] { return !guard.stands(); }));
  ASSERT_EQ(kill(numberOfSingle(), SIGCONT), 0);
  EXPECT_TRUE(test::eventually([&] { return guard.stands(); }));
}

TEST_F(Noting, ThatIsStoppedFindsItsDismissalWhenItWakesUp) {
  GuardProcess guard(single());
  ASSERT_TRUE(test::eventually([&] { return beats() >= 3; }));
  ASSERT_EQ(kill(numberOfSingle(), SIGSTOP), 0);
  ASSERT_TRUE(test::eventually([&] { return !guard.stands(); }));
  guard.dismiss();
  EXPECT_FALSE(guard.stands());
  EXPECT_EQ(told(), "");
  ASSERT_EQ(kill(numberOfSingle(), SIGCONT), 0);
  EXPECT_TRUE(test::eventually([&] { return told() == std::string(1, GuardProcess::kDismissal); }));
}

TEST_F(Noting, HasMoreTimeForItsFirstAnswerThanForOthers) {
  const double late = 1.5 * GuardProcess::kMissedBeats * GuardProcess::kBeatPeriod;
  GuardProcess guard({"/bin/sh", "-c",
                      "sleep " + std::to_string(late) + "; exec tee \"$0\" >&0 2>/dev/null",
                      note()});
  EXPECT_TRUE(test::eventually([&] { return beats() > 0 || !guard.stands(); }));
  EXPECT_TRUE(guard.stands());
}

TEST_F(Noting, ThatNeverAnswersDoesNotStand) {
  GuardProcess guard({"/bin/sh", "-c", "exec cat > \"$0\"", note()});
  EXPECT_TRUE(guard.stands());
  EXPECT_TRUE(test::eventually([&] { return !guard.stands(); }));
  EXPECT_GT(beats(), 0U);
}

TEST(GuardProcess, ThatCannotBeStartedIsNamed) {
  try {
    const GuardProcess guard({"/no/such/program"});
    FAIL() << "started";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("/no/such/program"), std::string::npos);
  }
}

}  // namespace
}  // namespace helix_arm::regulator
