#include "helix_arm/io/atomic_file.hpp"

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <set>
#include <thread>

#include <gtest/gtest.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "support/random.hpp"
#include "support/refusal.hpp"
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

constexpr int kPassed = 0, kFailed = 1, kSkipped = 77;

// The exit code of a child process that runs this; what it sets of itself ends with it.
int inChild(const std::function<int()>& body) {
  const pid_t child = ::fork();
  if (child == 0) {
    try {
      ::_exit(body());
    } catch (const std::exception& error) {
      std::cerr << error.what() << "\n";
      ::_exit(kFailed);
    }
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : kFailed;
}

// In a child: writing must fail with this reason and leave the folder as it was.
int refusesAndLeavesAll(const std::string& folder, const std::string& text,
                        const std::string& reason) {
  const auto names = namesIn(folder);
  const std::string path = folder + "/scene.yaml", before = contentOf(path);
  const std::string message = refusal(path, text);
  if (message.find(path + " cannot be written: " + reason + "; ") != 0 ||
      contentOf(path) != before || namesIn(folder) != names) {
    std::cerr << "said \"" << message << "\"; expected " << reason << "\n";
    return kFailed;
  }
  return kPassed;
}

TEST(AtomicFile, ContainsTheLastCompleteWrite) {
  const TemporaryFolder folder;
  const std::string path = folder / "scene.yaml";
  std::string bytes;
  for (int i = 0; i < 100000; ++i) bytes += static_cast<char>(i);
  for (const std::string& text : {std::string("first"), bytes, std::string(), std::string("x")}) {
    writeFileAtomically(path, text);
    EXPECT_EQ(contentOf(path), text);
    EXPECT_EQ(namesIn(folder.path()), std::set<std::string>{"scene.yaml"});
  }
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

TEST(AtomicFile, MayBeNamedWithoutItsFolder) {
  const TemporaryFolder folder;
  const fs::path before = fs::current_path();
  fs::current_path(folder.path());
  const std::string message = refusal("scene.yaml", "text");
  fs::current_path(before);
  EXPECT_EQ(message, "");
  EXPECT_EQ(contentOf(folder / "scene.yaml"), "text");
}

TEST(AtomicFile, KeepsThePermissionsItHas) {
  const TemporaryFolder folder;
  const std::string path = folder / "scene.yaml";
  const auto mode = [](const std::string& file) {
    struct stat status {};
    ::stat(file.c_str(), &status);
    return status.st_mode & 07777;
  };
  const mode_t mask = ::umask(027);
  writeFileAtomically(path, "new");
  ::umask(mask);
  EXPECT_EQ(mode(path), 0640u) << "a new one has those that the process gives";
  for (const mode_t kept : {0600u, 0664u, 0200u}) {
    ASSERT_EQ(::chmod(path.c_str(), kept), 0);
    writeFileAtomically(path, "again");
    EXPECT_EQ(mode(path), kept);
  }
}

TEST(AtomicFile, AReadOnlyFileIsKept) {
  const TemporaryFolder folder;
  const std::string path = folder / "scene.yaml";
  std::ofstream(path) << "old";
  ASSERT_EQ(::chmod(path.c_str(), 0444), 0);
  EXPECT_EQ(
      refusal(path, "new"),
      path + " cannot be written: it is read-only; allow writing to it, or choose another path");
  EXPECT_EQ(contentOf(path), "old");
  EXPECT_EQ(namesIn(folder.path()), std::set<std::string>{"scene.yaml"});
}

TEST(AtomicFile, ALinkFromSceneToSceneIsFollowed) {
  const TemporaryFolder folder;
  fs::create_directory(folder / "real");
  std::ofstream(folder / "real/scene.yaml") << "old";
  fs::create_symlink("real/scene.yaml", folder / "link.yaml");
  writeFileAtomically(folder / "link.yaml", "new");
  EXPECT_TRUE(fs::is_symlink(folder / "link.yaml"));
  EXPECT_EQ(contentOf(folder / "real/scene.yaml"), "new");
  EXPECT_EQ(namesIn(folder / "real"), std::set<std::string>{"scene.yaml"});
}

TEST(AtomicFile, AnyOtherLinkIsRefusedAndBothAreKept) {
  const std::pair<const char*, const char*> pairs[] = {{"tags.pdf", "scene.yaml"},
                                                       {"tags.pdf", "thesis.pdf"},
                                                       {"scene.yaml", "table.csv"},
                                                       {"out", "profile"}};
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

TEST(AtomicFile, AFileInALinkedFolderIsWritten) {
  const TemporaryFolder folder;
  fs::create_directory(folder / "real");
  fs::create_directory_symlink("real", folder / "link");
  for (const char* text : {"new", "again"}) {
    writeFileAtomically(folder / "link/tags.pdf", text);
    EXPECT_EQ(contentOf(folder / "real/tags.pdf"), text);
  }
}

TEST(AtomicFile, ALinkToNothingIsRefusedAndKept) {
  const TemporaryFolder folder;
  const std::string link = folder / "link.yaml";
  fs::create_symlink(folder / "nothing.yaml", link);
  const std::string message = link +
                              " cannot be written: it is a link to a file that does not exist; "
                              "remove the link, or name the file that it leads to";
  EXPECT_EQ(refusal(link, "text"), message);
  fs::create_symlink("loop.yaml", folder / "loop.yaml");
  EXPECT_NE(refusal(folder / "loop.yaml", "text"), "");
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_TRUE(fs::is_symlink(folder / "loop.yaml"));
  EXPECT_EQ(namesIn(folder.path()), (std::set<std::string>{"link.yaml", "loop.yaml"}));
}

TEST(AtomicFile, OnlyAFileIsReplaced) {
  const TemporaryFolder folder;
  EXPECT_EQ(refusal(folder.path(), "text"),
            folder.path() + " cannot be written: it is a folder; expected the path of a file");
  const std::string pipe = folder / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  for (const std::string& path : {pipe, std::string("/dev/full")}) {
    EXPECT_EQ(refusal(path, "text"), path +
                                         " cannot be written: it is not a regular file; expected "
                                         "the path of a regular file, or a new one");
  }
  EXPECT_TRUE(fs::is_character_file("/dev/full"));
  EXPECT_EQ(refusal("", "text"),
            " cannot be written: it names no file; expected the path of a file");
  EXPECT_EQ(refusal(folder / "none/scene.yaml", "text"),
            folder / "none/scene.yaml" +
                " cannot be written: No such file or directory; choose another path");
  EXPECT_EQ(refusal(pipe + "/scene.yaml", "text"),
            pipe + "/scene.yaml cannot be written: Not a directory; choose another path");
}

TEST(AtomicFile, AFolderThatMayNotBeWrittenToIsLeftAlone) {
  const TemporaryFolder folder;
  std::ofstream(folder / "scene.yaml") << "old";
  ASSERT_EQ(::chmod((folder / "scene.yaml").c_str(), 0666), 0);
  ASSERT_EQ(::chmod(folder.path().c_str(), 0555), 0);
  const int result = inChild([&folder] {
    constexpr uid_t kNobody = 65534;  // root may write everywhere
    if (::geteuid() == 0 && ::seteuid(kNobody) != 0) return kSkipped;
    return refusesAndLeavesAll(folder.path(), "new", "Permission denied");
  });
  ASSERT_EQ(::chmod(folder.path().c_str(), 0755), 0);
  if (result == kSkipped) GTEST_SKIP() << "this process may not become another user";
  EXPECT_EQ(result, kPassed);
}

TEST(AtomicFile, AFileThatGrowsTooLargeLeavesTheOldOne) {
  const TemporaryFolder folder;
  std::ofstream(folder / "scene.yaml") << "old";
  EXPECT_EQ(inChild([&folder] {
              std::signal(SIGXFSZ, SIG_IGN);
              const rlimit limit{10000, 10000};
              if (::setrlimit(RLIMIT_FSIZE, &limit) != 0) return kFailed;
              return refusesAndLeavesAll(folder.path(), std::string(20000, 'x'), "File too large");
            }),
            kPassed);
}

TEST(AtomicFile, AFullDiskLeavesTheOldFile) {
  const TemporaryFolder folder;
  const std::string disk = folder / "disk";
  fs::create_directory(disk);
  const int result = inChild([&disk] {
    // In a name space of its own the disk goes away with the process.
    const std::string user = std::to_string(::geteuid()), group = std::to_string(::getegid());
    if (::unshare(CLONE_NEWNS) != 0) {
      if (::unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) return kSkipped;
      std::ofstream("/proc/self/setgroups") << "deny";
      std::ofstream("/proc/self/uid_map") << "0 " + user + " 1";
      std::ofstream("/proc/self/gid_map") << "0 " + group + " 1";
    }
    ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr);
    if (::mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=16k") != 0) return kSkipped;
    writeFileAtomically(disk + "/scene.yaml", std::string(5000, 'o'));
    const int refused =
        refusesAndLeavesAll(disk, std::string(20000, 'n'), "No space left on device");
    if (refused != kPassed) return refused;
    // There is room again.
    writeFileAtomically(disk + "/scene.yaml", "small");
    return contentOf(disk + "/scene.yaml") == "small" ? kPassed : kFailed;
  });
  if (result == kSkipped) GTEST_SKIP() << "this process may not mount a small disk";
  EXPECT_EQ(result, kPassed);
}

TEST(AtomicFile, SeveralWritersLeaveOneWholeFile) {
  const TemporaryFolder folder;
  const std::string path = folder / "scene.yaml";
  constexpr int kWriters = 4;
  std::set<std::string> versions;
  std::vector<std::thread> writers;
  for (int i = 0; i < kWriters; ++i) {
    const std::string text(20000 + 1000 * i, static_cast<char>('a' + i));
    versions.insert(text);
    writers.emplace_back([path, text] {
      for (int k = 0; k < 25; ++k) writeFileAtomically(path, text);
    });
  }
  for (std::thread& writer : writers) writer.join();
  EXPECT_EQ(versions.count(contentOf(path)), 1u);
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
  for (int kill = 0; kill < kills; ++kill) {
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
  EXPECT_GT(namesIn(folder.path()).size(), 1U) << "none was killed while it wrote";
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

TEST(Sha256, OfAFileIsThatOfItsBytes) {
  std::string bytes;
  for (int i = 0; i < 300000; ++i) bytes += static_cast<char>(i * 7 + i / 251);
  EXPECT_EQ(sha256OfFile(test::TemporaryFile(bytes).path()), sha256Of(bytes));
  EXPECT_EQ(sha256OfFile(test::TemporaryFile("").path()), sha256Of(""));
}

TEST(Sha256, OfAFileThatCannotBeReadIsRefused) {
  const test::TemporaryFolder folder;
  const auto message = [](const std::string& path) {
    return test::refusal<FileError>([&path] { sha256OfFile(path); });
  };
  const std::string expected = "; expected an existing, readable file";
  EXPECT_EQ(message("/nowhere.csv"),
            "/nowhere.csv cannot be read: No such file or directory" + expected);
  EXPECT_EQ(message(folder.path()), folder.path() + " cannot be read: Is a directory" + expected);
}

}  // namespace
}  // namespace helix_arm::io
