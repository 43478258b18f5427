#include "regular_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

#include <fcntl.h>
#include <unistd.h>

namespace helix_arm::basics {
namespace {

constexpr std::size_t kBlock = 1U << 16U;

std::string reasonOf(int error) { return std::string("cannot be read: ") + std::strerror(error); }

const char* kindOf(mode_t mode) {
  switch (mode & S_IFMT) {
    case S_IFCHR:
    case S_IFBLK:
      return "a device";
    case S_IFIFO:
      return "a FIFO";
    case S_IFSOCK:
      return "a socket";
    default:
      return "a special file";
  }
}

// Empty for a regular file.
std::string faultOf(const struct stat& status) {
  if (S_ISREG(status.st_mode)) return {};
  if (S_ISDIR(status.st_mode)) return reasonOf(EISDIR);
  return std::string("is ") + kindOf(status.st_mode) + "; expected a regular file";
}

}  // namespace

RegularFile::RegularFile(const std::string& path) {
  struct stat status {};
  // Opening a device may have side effects, so the kind is checked first; it is checked again on
  // the open file, in case the path was replaced in between.
  if (::stat(path.c_str(), &status) != 0) {
    fault_ = reasonOf(errno);
  } else if (fault_ = faultOf(status); fault_.empty()) {
    file_ = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (file_ < 0 || ::fstat(file_, &status) != 0) {
      fault_ = reasonOf(errno);
    } else {
      fault_ = faultOf(status);
    }
  }
  opened_ = status;
  if (fault_.empty() || file_ < 0) return;
  ::close(file_);
  file_ = -1;
}

RegularFile::~RegularFile() {
  if (file_ >= 0) ::close(file_);
}

std::optional<std::string> RegularFile::readAll(std::size_t most) {
  if (!isOpen()) return std::nullopt;
  const std::uint64_t expected = size();
  std::string bytes;
  if (expected <= most) bytes.reserve(static_cast<std::size_t>(expected));
  std::vector<char> block(kBlock);
  // A file may grow while it is read, and files below /proc state no size.
  while (expected <= most && bytes.size() <= most) {
    const ssize_t count = readAt(bytes.size(), block.data(), block.size());
    if (count < 0) return std::nullopt;
    if (count == 0) return bytes;
    bytes.append(block.data(), static_cast<std::size_t>(count));
  }
  fault_ = largerThan(most);
  return std::nullopt;
}

ssize_t RegularFile::readAt(std::uint64_t place, void* bytes, std::size_t size) {
  for (;;) {
    const ssize_t count = ::pread(file_, bytes, size, static_cast<off_t>(place));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) fault_ = reasonOf(errno);
    return count;
  }
}

struct stat RegularFile::status() const {
  struct stat out {};
  if (::fstat(file_, &out) != 0) out = {};
  return out;
}

std::uint64_t RegularFile::size() const {
  return static_cast<std::uint64_t>(std::max<off_t>(status().st_size, 0));
}

bool RegularFile::isUnchanged() const {
  const struct stat now = status();
  const auto same = [](const timespec& a, const timespec& b) {
    return a.tv_sec == b.tv_sec && a.tv_nsec == b.tv_nsec;
  };
  return now.st_size == opened_.st_size && same(now.st_mtim, opened_.st_mtim) &&
         same(now.st_ctim, opened_.st_ctim);
}

std::string largerThan(std::uint64_t most) {
  constexpr std::uint64_t kMebibyte = 1U << 20U, kGibibyte = 1U << 30U;
  const auto in = [most](std::uint64_t unit, const char* name) {
    return "is larger than " + std::to_string(most / unit) + name;
  };
  if (most >= kGibibyte && most % kGibibyte == 0) return in(kGibibyte, " GiB");
  if (most >= kMebibyte && most % kMebibyte == 0) return in(kMebibyte, " MiB");
  return in(1, " bytes");
}

}  // namespace helix_arm::basics
