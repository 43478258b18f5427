#include "helix_arm/io/atomic_file.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include <dirent.h>
#include <fcntl.h>
#include <openssl/evp.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "helix_arm/basics/quote.hpp"

namespace helix_arm::io {
namespace {

namespace fs = std::filesystem;

constexpr int kNameDigits = 16;  // of a temporary file
const char* const kSuffix = ".tmp";
constexpr mode_t kPermissions = 07777;

[[noreturn]] void refuse(const std::string& path, const std::string& reason,
                         const std::string& remedy) {
  throw FileError(basics::printable(path) + " cannot be written: " + reason + "; " + remedy);
}

const char* remedyOf(int error) {
  switch (error) {
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
      return "free disk space, or choose another path";
    default:
      return "choose another path";
  }
}

[[noreturn]] void refuse(const std::string& path, int error) {
  refuse(path, std::strerror(error), remedyOf(error));
}

class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Descriptor& operator=(Descriptor&&) = delete;
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  int operator*() const { return number_; }
  bool isOpen() const { return number_ >= 0; }
  bool close() { return ::close(std::exchange(number_, -1)) == 0; }

 private:
  int number_;
};

std::string prefixOf(const std::string& name) { return "." + name + "."; }

bool isTemporaryOf(const std::string& name, const std::string& entry) {
  const std::string prefix = prefixOf(name);
  const std::size_t size = prefix.size() + kNameDigits + std::strlen(kSuffix);
  return entry.size() == size && entry.compare(0, prefix.size(), prefix) == 0 &&
         entry.compare(prefix.size() + kNameDigits, std::string::npos, kSuffix) == 0 &&
         entry.find_first_not_of("0123456789abcdef", prefix.size()) == prefix.size() + kNameDigits;
}

std::string temporaryName(const std::string& name) {
  std::random_device random;
  std::string digits;
  for (int i = 0; i < kNameDigits; ++i) digits += "0123456789abcdef"[random() & 15];
  return prefixOf(name) + digits + kSuffix;
}

// A writer locks its temporary file, and the system releases the lock when the writer ends. A file
// that can be locked here has been abandoned.
void removeAbandoned(int folder, const std::string& name) {
  const int listed = ::openat(folder, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (listed < 0) return;
  DIR* const entries = ::fdopendir(listed);
  if (entries == nullptr) {
    ::close(listed);
    return;
  }
  std::vector<std::string> found;
  while (const dirent* entry = ::readdir(entries)) {
    if (isTemporaryOf(name, entry->d_name)) found.emplace_back(entry->d_name);
  }
  ::closedir(entries);
  for (const std::string& entry : found) {
    const Descriptor file(::openat(folder, entry.c_str(), O_RDWR | O_NOFOLLOW | O_CLOEXEC));
    if (file.isOpen() && ::flock(*file, LOCK_EX | LOCK_NB) == 0) {
      ::unlinkat(folder, entry.c_str(), 0);
    }
  }
}

// A new file in a folder; the destructor removes it unless it was renamed.
class TemporaryFile {
 public:
  TemporaryFile(const Descriptor& folder, const std::string& name, const std::string& path)
      : folder_(*folder), path_(path), file_(create(name)) {}
  ~TemporaryFile() {
    if (!name_.empty()) ::unlinkat(folder_, name_.c_str(), 0);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  void setPermissions(mode_t mode) const {
    if (::fchmod(*file_, mode) != 0) refuse(path_, errno);
  }

  void write(std::string_view bytes) {
    writeAt(end_, bytes);
    end_ += bytes.size();
  }

  void writeAt(std::size_t place, std::string_view bytes) const {
    for (std::size_t done = 0; done < bytes.size();) {
      const ssize_t count = ::pwrite(*file_, bytes.data() + done, bytes.size() - done,
                                     static_cast<off_t>(place + done));
      if (count < 0 && errno == EINTR) continue;
      if (count < 0) refuse(path_, errno);
      done += static_cast<std::size_t>(count);
    }
  }

  void sync() const {
    if (::fsync(*file_) != 0) refuse(path_, errno);
  }

  void renameTo(const std::string& name) {
    if (::renameat(folder_, name_.c_str(), folder_, name.c_str()) != 0) refuse(path_, errno);
    name_.clear();
  }

 private:
  Descriptor create(const std::string& name) {
    while (true) {
      name_ = temporaryName(name);
      constexpr int kNew = O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;
      Descriptor file(::openat(folder_, name_.c_str(), kNew, 0666));
      const int error = errno;
      if (!file.isOpen()) name_.clear();
      if (!file.isOpen() && error == EEXIST) continue;
      if (!file.isOpen()) refuse(path_, error);
      // Between creation and lock, another writer may remove the file as abandoned. On file systems
      // without locks it cannot.
      const bool taken = ::flock(*file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
      struct stat now {};
      if (!taken && ::fstat(*file, &now) == 0 && now.st_nlink > 0) return file;
    }
  }

  int folder_;
  const std::string path_;
  std::string name_;
  std::size_t end_ = 0;
  Descriptor file_;
};

struct Target {
  std::string directory, name;
  std::optional<mode_t> permissions;  // of the existing file
};

Target targetOf(const std::string& path) {
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
  // A scene may be kept under a second name. Any other result would replace a file that its path
  // does not name.
  const auto isScene = [](const fs::path& file) { return file.extension() == ".yaml"; };
  if (is_there && S_ISLNK(entry.st_mode) && !(isScene(path) && isScene(target))) {
    refuse(path, "it is a link to " + basics::printable(target.string()),
           "remove the link, or name the file that it leads to");
  }
  const std::string name = target.filename().string();
  if (name.empty()) refuse(path, "it names no file", "expected the path of a file");
  const std::string directory = target.has_parent_path() ? target.parent_path().string() : ".";
  Target out{directory, name, {}};
  if (exists) out.permissions = present.st_mode & kPermissions;
  return out;
}

Descriptor openFolder(const std::string& directory, const std::string& path) {
  Descriptor folder(::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!folder.isOpen()) refuse(path, errno);
  return folder;
}

}  // namespace

class AtomicFile::Place {
 public:
  explicit Place(const std::string& path)
      : path_(path),
        target_(targetOf(path)),
        folder_(openFolder(target_.directory, path)),
        file_(clearedFolder(), target_.name, path) {
    if (target_.permissions) file_.setPermissions(*target_.permissions);
  }

  TemporaryFile& file() { return file_; }

  void commit() {
    file_.sync();
    file_.renameTo(target_.name);
    // Not every file system can sync a folder; those that cannot return EINVAL.
    if (::fsync(*folder_) != 0 && errno != EINVAL) {
      throw FileError(basics::printable(path_) +
                      " is written, but a loss of power may undo it: its folder cannot be "
                      "synced: " +
                      std::strerror(errno) + "; check the disk");
    }
  }

 private:
  const Descriptor& clearedFolder() const {
    removeAbandoned(*folder_, target_.name);
    return folder_;
  }

  const std::string path_;
  const Target target_;
  const Descriptor folder_;
  TemporaryFile file_;
};

AtomicFile::AtomicFile(const std::string& path) : place_(std::make_unique<Place>(path)) {}
AtomicFile::~AtomicFile() = default;
void AtomicFile::write(std::string_view bytes) { place_->file().write(bytes); }
void AtomicFile::writeOver(std::size_t place, std::string_view bytes) {
  place_->file().writeAt(place, bytes);
}
void AtomicFile::commit() { place_->commit(); }

void writeFileAtomically(const std::string& path, const std::string& text) {
  AtomicFile file(path);
  file.write(text);
  file.commit();
}

namespace {

constexpr std::size_t kBlock = 1 << 16;

class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
    check(context_ != nullptr && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1);
  }
  void add(const void* bytes, std::size_t count) {
    check(EVP_DigestUpdate(context_.get(), bytes, count) == 1);
  }
  std::string digits() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
    unsigned int size = 0;
    check(EVP_DigestFinal_ex(context_.get(), digest.data(), &size) == 1);
    std::string text;
    for (unsigned int i = 0; i < size; ++i) {
      text += "0123456789abcdef"[digest[i] >> 4];
      text += "0123456789abcdef"[digest[i] & 15];
    }
    return text;
  }

 private:
  static void check(bool done) {
    if (!done) throw std::runtime_error("SHA-256 is not available from OpenSSL");
  }

  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

}  // namespace

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
