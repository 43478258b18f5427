#include "atomic_file.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <random>

#include <fcntl.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include "basics/quote.hpp"
#include "basics/text.hpp"

namespace helix_arm::io {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& path, const std::string& reason,
                         const std::string& remedy) {
  throw FileError(basics::printable(path) + " cannot be written: " + reason + "; " + remedy);
}

[[noreturn]] void refuse(const std::string& path, int error) {
  const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  refuse(path, std::strerror(error),
         full ? "free disk space, or choose another path" : "choose another path");
}

// The file that a path leads to, which may not exist yet.
std::string targetOf(const std::string& path) {
  struct stat present {};
  const bool exists = ::stat(path.c_str(), &present) == 0;
  if (!exists && errno != ENOENT) refuse(path, errno);
  // A device would be replaced by a file, and a dangling link would create a file elsewhere.
  struct stat entry {};
  const bool is_there = ::lstat(path.c_str(), &entry) == 0;
  if (!exists && is_there) {
    refuse(path, "it is a link to a file that does not exist",
           "remove the link, or name the file that it leads to");
  }
  if (exists && S_ISDIR(present.st_mode)) {
    refuse(path, "it is a folder", "expected the path of a file");
  }
  if (exists && !S_ISREG(present.st_mode)) {
    refuse(path, "it is not a regular file", "expected the path of a regular file, or a new one");
  }
  // A read-only file is kept, even if the system would allow replacing it: that depends on its
  // folder only, and root may do anything.
  constexpr mode_t kWritable = S_IWUSR | S_IWGRP | S_IWOTH;
  if (exists && ((present.st_mode & kWritable) == 0 ||
                 ::faccessat(AT_FDCWD, path.c_str(), W_OK, AT_EACCESS) != 0)) {
    refuse(path, "it is read-only", "allow writing to it, or choose another path");
  }
  std::error_code error;
  const fs::path target = exists ? fs::canonical(path, error) : fs::path(path);
  if (error) refuse(path, error.value());
  // A scene may have a second name. Others would replace a file that their path does not name.
  const auto isScene = [](const fs::path& file) { return file.extension() == ".yaml"; };
  if (is_there && S_ISLNK(entry.st_mode) && !(isScene(path) && isScene(target))) {
    refuse(path, "it is a link to " + basics::printable(target.string()),
           "remove the link, or name the file that it leads to");
  }
  if (!target.has_filename()) refuse(path, "it names no file", "expected the path of a file");
  return target;
}

constexpr std::size_t kBlock = 1 << 16;

class Sha256 {
 public:
  Sha256() { check(context_ && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1); }
  void add(const void* bytes, std::size_t count) {
    check(EVP_DigestUpdate(context_.get(), bytes, count) == 1);
  }
  std::string digits() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
    unsigned int size = 0;
    check(EVP_DigestFinal_ex(context_.get(), digest.data(), &size) == 1);
    std::string text;
    for (unsigned int i = 0; i < size; ++i) text += basics::format("%02x", digest[i]);
    return text;
  }

 private:
  static void check(bool done) {
    if (!done) throw std::runtime_error("SHA-256 is not available from OpenSSL");
  }

  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_{EVP_MD_CTX_new(),
                                                                   &EVP_MD_CTX_free};
};

}  // namespace

AtomicFile::AtomicFile(const std::string& path) : path_(path), target_(targetOf(path)) {
  const fs::path target(target_);
  struct stat present {};
  const bool exists = ::stat(target_.c_str(), &present) == 0;
  std::random_device random;
  temporary_ = target.parent_path() /
               basics::format(".%s.%08x%08x.tmp", target.filename().c_str(), random(), random());
  constexpr int kNew = O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;
  file_ = ::open(temporary_.c_str(), kNew, 0666);
  if (file_ < 0) refuse(path_, errno);
  if (exists && ::fchmod(file_, present.st_mode & 07777) != 0) {
    const int error = errno;
    discard();
    refuse(path_, error);
  }
}

AtomicFile::~AtomicFile() { discard(); }

void AtomicFile::discard() {
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
  ::close(file_);
}

void AtomicFile::write(std::string_view bytes) {
  writeOver(end_, bytes);
  end_ += bytes.size();
}

void AtomicFile::writeOver(std::size_t place, std::string_view bytes) {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t count =
        ::pwrite(file_, bytes.data() + done, bytes.size() - done, static_cast<off_t>(place + done));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) refuse(path_, errno);
    done += static_cast<std::size_t>(count);
  }
}

void AtomicFile::commit() {
  if (::fsync(file_) != 0 || ::rename(temporary_.c_str(), target_.c_str()) != 0) {
    refuse(path_, errno);
  }
  temporary_.clear();
  const fs::path folder = fs::absolute(target_).parent_path();
  const int opened = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool synced = opened >= 0 && ::fsync(opened) == 0;
  const int error = errno;
  ::close(opened);
  // Not every file system can sync a folder; those that cannot return EINVAL.
  if (!synced && error != EINVAL) {
    throw FileError(basics::printable(path_) +
                    " is written, but a loss of power may undo it: its folder cannot be synced: " +
                    std::strerror(error) + "; check the disk");
  }
}

void writeFileAtomically(const std::string& path, const std::string& text) {
  AtomicFile file(path);
  file.write(text);
  file.commit();
}

std::string sha256Of(const std::string& content) {
  Sha256 hash;
  hash.add(content.data(), content.size());
  return hash.digits();
}

std::string sha256OfFile(basics::RegularFile& file, const std::string& path, std::uint64_t most) {
  const auto refuse = [&path](const std::string& fault) {
    const bool complete = fault.find("; expected ") != std::string::npos;
    throw FileError(path + " " + fault + (complete ? "" : "; expected an existing, readable file"));
  };
  const std::string too_large = basics::largerThan(most) + "; expected a smaller file";
  if (!file.isOpen()) refuse(file.fault());
  if (file.size() > most) refuse(too_large);
  Sha256 hash;
  std::string block(kBlock, '\0');
  std::uint64_t place = 0;
  for (ssize_t count; (count = file.readAt(place, block.data(), block.size())) != 0;) {
    if (count < 0) refuse(file.fault());
    place += static_cast<std::uint64_t>(count);
    if (place > most) refuse(too_large);
    hash.add(block.data(), static_cast<std::size_t>(count));
  }
  return hash.digits();
}

std::string sha256OfFile(const std::string& path) {
  constexpr std::uint64_t kMost = 64U << 20U;
  basics::RegularFile file(path);
  return sha256OfFile(file, path, kMost);
}

}  // namespace helix_arm::io
