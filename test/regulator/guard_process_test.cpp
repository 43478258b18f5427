#include "helix_arm/regulator/guard_process.hpp"

#include <csignal>

#include <sys/prctl.h>
#include <sys/wait.h>

#include "support/eventually.hpp"
#include "support/has.hpp"
#include "support/refusal.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"

namespace helix_arm::regulator {
namespace {

namespace fs = std::filesystem;
using control::Guard;

// A guard that answers, and notes what it was told, beats aside, until its input ended.
class Noting : public ::testing::Test {
 protected:
  std::string told() const {
    std::string words = test::contentOf(note());
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
    EXPECT_FALSE(control::isGone(guard.state()));
    guard.dismiss();
    EXPECT_EQ(guard.state(), Guard::kEnded);
  }
  EXPECT_TRUE(test::eventually([&] { return fs::exists(done()); }));
  EXPECT_EQ(told(), std::string(1, GuardProcess::kDismissal));
}

TEST_F(Noting, GuardsOnUnlessDismissed) {
  { const GuardProcess guard(command()); }
  EXPECT_TRUE(test::eventually([&] { return fs::exists(done()); }));
  EXPECT_EQ(told(), "");
}

TEST_F(Noting, OutlivesAKilledProcessGroupAndNoticesIt) {
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

TEST_F(Noting, SendsBeatsByItself) {
  const GuardProcess guard(command());
  EXPECT_TRUE(test::eventually([&] { return beats() >= 3; }));
  EXPECT_EQ(told(), "");
}

TEST_F(Noting, ThatHasEndedNeverStood) {
  const GuardProcess guard({"/bin/true"});
  bool stood = false;
  EXPECT_TRUE(test::eventually([&] {
    stood = stood || guard.state() == Guard::kStands;
    return guard.state() == Guard::kEnded;
  }));
  EXPECT_FALSE(stood);
}

// Silence takes ten beats to be known, an end takes none.
TEST_F(Noting, ThatIsKilledIsKnownToHaveEndedBeforeItMissesABeat) {
  const GuardProcess guard(single());
  ASSERT_TRUE(test::eventually([&] { return guard.state() == Guard::kStands; }));
  ASSERT_EQ(kill(numberOfSingle(), SIGKILL), 0);
  ASSERT_EQ(waitid(P_PID, static_cast<id_t>(numberOfSingle()), nullptr, WEXITED | WNOWAIT), 0);
  EXPECT_EQ(guard.state(), Guard::kEnded);
}

TEST_F(Noting, IsReadyOnlyAfterItsFirstAnswer) {
  const std::string go = folder_ / "go";
  const GuardProcess guard(
      {"/bin/sh", "-c", "until [ -e \"$1\" ]; do sleep 0.05; done; exec tee \"$0\" >&0 2>/dev/null",
       note(), go});
  EXPECT_EQ(guard.state(), Guard::kStarting);
  EXPECT_EQ(beats(), 0U);
  std::ofstream(go).put('\n');
  EXPECT_TRUE(test::eventually([&] { return guard.state() == Guard::kStands; }));
}

TEST_F(Noting, IsNotReadyWhileStopped) {
  GuardProcess guard(single());
  ASSERT_TRUE(test::eventually([&] { return beats() >= 3; }));
  EXPECT_TRUE(test::eventually([&] { return guard.state() == Guard::kStands; }));
  ASSERT_EQ(kill(numberOfSingle(), SIGSTOP), 0);
  EXPECT_TRUE(test::eventually([&] { return guard.state() == Guard::kStandsStill; }));
  ASSERT_EQ(kill(numberOfSingle(), SIGCONT), 0);
  EXPECT_TRUE(test::eventually([&] { return guard.state() == Guard::kStands; }));
}

TEST_F(Noting, ThatIsStoppedFindsItsDismissalWhenItWakesUp) {
  GuardProcess guard(single());
  ASSERT_TRUE(test::eventually([&] { return beats() >= 3; }));
  ASSERT_EQ(kill(numberOfSingle(), SIGSTOP), 0);
  ASSERT_TRUE(test::eventually([&] { return guard.state() == Guard::kStandsStill; }));
  guard.dismiss();
  EXPECT_EQ(guard.state(), Guard::kEnded);
  EXPECT_EQ(told(), "");
  ASSERT_EQ(kill(numberOfSingle(), SIGCONT), 0);
  EXPECT_TRUE(test::eventually([&] { return told() == std::string(1, GuardProcess::kDismissal); }));
}

TEST_F(Noting, HasMoreTimeForItsFirstAnswerThanForOthers) {
  const double late = 1.5 * GuardProcess::kMissedBeats * GuardProcess::kBeatPeriod;
  GuardProcess guard({"/bin/sh", "-c",
                      "sleep " + std::to_string(late) + "; exec tee \"$0\" >&0 2>/dev/null",
                      note()});
  EXPECT_TRUE(test::eventually([&] { return guard.state() != Guard::kStarting; }));
  EXPECT_EQ(guard.state(), Guard::kStands);
}

TEST_F(Noting, ThatNeverAnswersDoesNotStand) {
  GuardProcess guard({"/bin/sh", "-c", "exec cat > \"$0\"", note()});
  EXPECT_EQ(guard.state(), Guard::kStarting);
  EXPECT_TRUE(test::eventually([&] { return guard.state() == Guard::kStandsStill; }));
  EXPECT_GT(beats(), 0U);
}

TEST(GuardProcess, ThatCannotBeStartedIsNamed) {
  EXPECT_TRUE(test::has(
      test::refusal<std::runtime_error>([] { const GuardProcess guard({"/no/such/program"}); }),
      "/no/such/program"));
}

}  // namespace
}  // namespace helix_arm::regulator
