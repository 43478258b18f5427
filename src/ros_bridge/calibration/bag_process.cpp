#include "bag_process.hpp"

#include <cerrno>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <utility>

#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include "helix_arm/basics/quote.hpp"
#include "helix_arm/io/fault_list.hpp"

namespace helix_arm::ros_bridge {
namespace {

constexpr int kSilence = 300'000;  // [ms] without output, after which the reader is killed

// bag_reader is installed with the programs of this package.
std::string readerProgram() {
  Dl_info library{};
  dladdr(reinterpret_cast<const void*>(&readerProgram), &library);
  std::error_code ignored;
  const std::filesystem::path here =
      std::filesystem::weakly_canonical(library.dli_fname, ignored).parent_path();
  return (here / "helix_arm/bag_reader").string();
}

}  // namespace

BagProcess::BagProcess(const basics::RegularFile& file, std::string path) : path_(std::move(path)) {
  const std::string program = readerProgram();
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) refuse(std::string("cannot be read: ") + std::strerror(errno));
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, file.descriptor(), STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
#if __GLIBC_PREREQ(2, 34)
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
#endif
  // The child starts with default signals, whatever this process has set.
  sigset_t all, none;
  sigfillset(&all);
  sigemptyset(&none);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK);
  char* const arguments[] = {const_cast<char*>(program.c_str()), nullptr};
  const int error =
      posix_spawn(&process_, program.c_str(), &actions, &attributes, arguments, environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  ::close(ends[1]);
  pipe_ = ends[0];
  if (error == 0) return;
  ::close(pipe_);
  process_ = -1;
  refuse("cannot be read: " + program + " does not start: " + std::strerror(error) +
         "; install helix_arm again");
}

BagProcess::~BagProcess() {
  ::close(pipe_);
  if (process_ < 0) return;
  kill(process_, SIGKILL);
  while (waitpid(process_, nullptr, 0) < 0 && errno == EINTR) continue;
}

BagRecord BagProcess::next() {
  RecordHead head{};
  read(&head, sizeof head);
  const bool sound = head.bytes <= kMostRecordBytes && static_cast<int>(head.topic) < kRecordTopics;
  if (!sound) {
    kill(process_, SIGKILL);  // it may wait for the rest of its output to be read
    refuse("is damaged: its content is not valid; expected an intact bag");
  }
  BagRecord record{head.kind, head.topic, std::vector<std::uint8_t>(head.bytes)};
  read(record.bytes.data(), record.bytes.size());
  if (record.kind == RecordKind::kFault) {
    const std::string fault(record.bytes.begin(), record.bytes.end());
    refuse("cannot be read: " + basics::quoted(fault, 200) +
           "; expected a bag that was closed (rosbag reindex repairs one that was not)");
  }
  return record;
}

void BagProcess::read(void* bytes, std::size_t size) {
  auto* place = static_cast<char*>(bytes);
  while (size > 0) {
    pollfd waited{pipe_, POLLIN, 0};
    const int ready = poll(&waited, 1, kSilence);
    if (ready < 0 && errno == EINTR) continue;
    if (ready == 0) refuse("takes too long to read; expected an intact bag");
    const ssize_t count = ::read(pipe_, place, size);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) failed();
    place += count;
    size -= static_cast<std::size_t>(count);
  }
}

void BagProcess::failed() {
  int status = 0;
  pid_t ended = 0;
  while ((ended = waitpid(process_, &status, 0)) < 0 && errno == EINTR) continue;
  process_ = -1;
  if (ended > 0 && WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU) {
    refuse("takes more than " + std::to_string(kMostReaderTime) +
           " s of processor time to read; expected a shorter or an intact bag");
  }
  const std::string reason =
      ended > 0 && WIFSIGNALED(status)
          ? std::string("reading it ended with ") + strsignal(WTERMSIG(status))
          : "reading it did not end";
  refuse("is damaged: " + reason +
         "; expected an intact bag (rosbag check examines it, rosbag reindex "
         "may repair it)");
}

void BagProcess::refuse(const std::string& fault) const {
  throw io::DocumentError(path_ + " " + fault);
}

}  // namespace helix_arm::ros_bridge
