#include "io/document/atomic_file.hpp"

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <set>
#include <thread>

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/random.hpp"
#include "support/temporary_file.hpp"
#include "support/temporary_folder.hpp"
#include "support/test_size.hpp"

namespace helix_arm::io {
namespace {

namespace fs = std::filesystem;
using test::contentOf;
using test::namesIn;
using test::TemporaryFolder;

// What writing says; empty when it says nothing.
std::string refusal(const std::string& path, const std::string& text) {
  try {
    writeFileAtomically(path, text);
  } catch (const FileError& error) {
    return error.what();
  }
  return {};
}

TEST(AtomicFile, ReplacesTheFileOnlyWhenComplete) {
  const TemporaryFolder folder;
  const std::string path = folder / "cloud.ply";
  std::ofstream(path) << "old";
  {
    AtomicFile file(path);
    file.write("head 00 ");
    for (int i = 0; i < 3; ++i) file.write("body ");
    file.writeOver(5, "12");
    file.write("end");
    EXPECT_EQ(contentOf(path), "old");
    EXPECT_EQ(namesIn(folder.path()).size(), 2u);
    file.commit();
    EXPECT_EQ(contentOf(path), "head 12 body body body end");
  }
  EXPECT_EQ(namesIn(folder.path()), std::set<std::string>{"cloud.ply"});
  {
    AtomicFile file(path);
    file.write("given up");
  }
  EXPECT_EQ(contentOf(path), "head 12 body body body end");
  EXPECT_EQ(namesIn(folder.path()), std::set<std::string>{"cloud.ply"});
}

TEST(AtomicFile, AnyOtherLinkIsRefusedAndBothAreKept) {
  const std::pair<const char*, const char*> pairs[] = {{"tags.pdf", "thesis.pdf"},
                                                       {"scene.yaml", "table.csv"}};
  for (const auto& [name, of] : pairs) {
    const TemporaryFolder folder;
    const std::string link = folder / name, file = folder / of;
    std::ofstream(file) << "old";
    fs::create_symlink(of, link);
    EXPECT_EQ(refusal(link, "text"), link + " cannot be written: it is a link to " +
                                         fs::canonical(file).string() +
                                         "; remove the link, or name the file that it leads to");
    EXPECT_TRUE(fs::is_symlink(link));
    EXPECT_EQ(contentOf(file), "old");
    EXPECT_EQ(namesIn(folder.path()), (std::set<std::string>{name, of}));
  }
}

TEST(AtomicFile, AFailedWriteLeavesTheOldFile) {
  const TemporaryFolder folder;
  const std::string path = folder / "scene.yaml";
  writeFileAtomically(path, "old");
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit small{10000, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const std::string message = refusal(path, std::string(20000, 'x'));
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  EXPECT_EQ(message.find(path + " cannot be written: File too large"), 0U) << message;
  EXPECT_EQ(contentOf(path), "old");
  EXPECT_EQ(namesIn(folder.path()), std::set<std::string>{"scene.yaml"});
}

// The temporary files that it leaves are not in the way of the next writer.
TEST(AtomicFile, AWriterKilledAtAnyMomentLeavesAWholeVersion) {
  const int kills = test::draws(20, 200);
  constexpr std::size_t kSize = 500000;
  const TemporaryFolder folder;
  const std::string path = folder / "scene.yaml";
  const std::string versions[] = {std::string(kSize, 'a'), std::string(kSize + 1234, 'b')};
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  for (const std::string& version : versions) writeFileAtomically(path, version);
  const std::chrono::duration<double> both = Clock::now() - start;
  test::Random random(17);
  // Until one was killed while it wrote, too: a busy machine may start a writer late.
  const auto deadline = start + std::chrono::seconds(60);
  const auto leftBehind = [&folder] { return namesIn(folder.path()).size() > 1; };
  for (int kill = 0; kill < kills || (!leftBehind() && Clock::now() < deadline); ++kill) {
    const pid_t writer = ::fork();
    ASSERT_GE(writer, 0);
    if (writer == 0) {
      for (int k = kill;; ++k) writeFileAtomically(path, versions[k % 2]);
    }
    std::this_thread::sleep_for(both * random.uniform(0, 2));
    ASSERT_EQ(::kill(writer, SIGKILL), 0);
    int status = 0;
    ASSERT_EQ(::waitpid(writer, &status, 0), writer);
    ASSERT_TRUE(WIFSIGNALED(status)) << "the writer must not end by itself";
    const std::string content = contentOf(path);
    ASSERT_TRUE(content == versions[0] || content == versions[1])
        << "after kill " << kill << " it holds " << content.size() << " bytes";
  }
  EXPECT_TRUE(leftBehind()) << "none was killed while it wrote";
}

// From FIPS 180-2, appendix B, and NIST's vectors of the empty message.
TEST(Sha256, IsThatOfTheStandard) {
  EXPECT_EQ(sha256Of(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256Of("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256Of("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256Of(std::string(1000000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

}  // namespace
}  // namespace helix_arm::io
