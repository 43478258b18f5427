#include "completion.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include "helix_arm/io/regulator_profile.hpp"
#include "helix_arm/io/shipped_files.hpp"

namespace helix_arm::cli {
namespace {

using Words = std::vector<std::string>;

// Names of offers, in the order of Offer.
constexpr const char* kOffers[] = {"words", "list", "scene", "profile"};
constexpr char kAnyFile[] = "*";
constexpr char kSceneFile[] = "*.yaml";
// Parts of the names of types that may be files; TEXT is of options that name no type.
constexpr const char* kFileTypes[] = {"FILE", "DIR", "PATH", "SCENE", "TEXT"};

// The words that were offered so; nullptr if none were.
CLI::Validator* offered(CLI::Option* option, Offer kind) {
  try {
    return option->get_validator(kOffers[static_cast<int>(kind)]);
  } catch (const CLI::OptionNotFound&) {
    return nullptr;
  }
}

Words wordsOf(CLI::Validator* words) {
  words->active(true);
  return CLI::detail::split(words->get_description(), ',');
}

// As the help lists them: TEXT:{a,b}.
Words wordsOfType(const CLI::Option* option) {
  const std::string type = option->get_type_name();
  const std::size_t begin = type.find('{');
  if (begin == std::string::npos) return {};
  return CLI::detail::split(type.substr(begin + 1, type.find('}') - begin - 1), ',');
}

struct Completions {
  std::string files;  // pattern
  Words words;
};

Completions valuesOf(CLI::Option* option, const std::string& word) {
  if (offered(option, Offer::kScene) != nullptr) {
    return {kSceneFile, io::shippedNames(io::kShippedScenes)};
  }
  if (CLI::Validator* const besides = offered(option, Offer::kProfile)) {
    Words words = wordsOf(besides);
    for (std::string& profile : io::shippedProfiles()) words.push_back(std::move(profile));
    return {"", words};
  }
  if (CLI::Validator* const words = offered(option, Offer::kWords)) return {"", wordsOf(words)};
  if (CLI::Validator* const list = offered(option, Offer::kList)) {
    Completions out{"", wordsOf(list)};
    const std::string before = word.substr(0, word.rfind(',') + 1);
    for (std::string& each : out.words) each.insert(0, before);
    return out;
  }
  if (Words words = wordsOfType(option); !words.empty()) return {"", words};
  const std::string type = option->get_type_name().substr(0, option->get_type_name().find(':'));
  const bool file =
      std::any_of(std::begin(kFileTypes), std::end(kFileTypes),
                  [&](const char* part) { return type.find(part) != std::string::npos; });
  return {file ? kAnyFile : "", {}};
}

bool takesMany(const CLI::Option* option) {
  return option->get_items_expected_max() > 1 && option->get_allow_extra_args();
}

bool isOption(const std::string& word) { return word.size() > 1 && word.front() == '-'; }

// Bash splits at =: --format=csv and KEY=VALUE are three words. They become --format= and csv, and
// KEY=VALUE.
Words joinedAtEquals(const Words& words) {
  Words out;
  bool glue = false;
  for (const std::string& word : words) {
    if (word == "=" && !out.empty()) {
      glue = !isOption(out.back());
      out.back() += word;
      if (&word == &words.back() && !glue) out.emplace_back();
    } else if (glue) {
      out.back() += word;
      glue = false;
    } else {
      out.push_back(word);
    }
  }
  return out;
}

// Goes through the words before the last one.
class Position {
 public:
  explicit Position(CLI::App& app) : command_(&app) {}

  void pass(const std::string& word) {
    if (awaited_ != nullptr && !(has_value_ && isOption(word))) {
      has_value_ = true;
      if (!takesMany(awaited_)) awaited_ = nullptr;
      return;
    }
    awaited_ = nullptr;
    has_value_ = false;
    const Words optional = optionalValues();
    flag_ = nullptr;
    if (std::find(optional.begin(), optional.end(), word) != optional.end()) return;
    if (isOption(word)) {
      passOption(word);
      return;
    }
    for (CLI::App* subcommand : subcommands()) {
      if (subcommand->get_name() != word) continue;
      command_ = subcommand;
      positionals_ = 0;
      return;
    }
    ++positionals_;
  }

  Completions completions(const std::string& word) {
    if (awaited_ != nullptr && !(has_value_ && isOption(word))) return valuesOf(awaited_, word);
    if (!word.empty() && word.front() == '-') return {"", optionNames()};
    Completions out;
    CLI::Option* const positional = nextPositional();
    const std::vector<CLI::App*> nested = subcommands();
    if (positional != nullptr && (nested.empty() || positional->get_required())) {
      out = valuesOf(positional, word);
    } else {
      for (const CLI::App* subcommand : nested) out.words.push_back(subcommand->get_name());
    }
    const Words optional = optionalValues();
    out.words.insert(out.words.begin(), optional.begin(), optional.end());
    return out;
  }

 private:
  // Behind an =, a flag has a value, too.
  void passOption(const std::string& word) {
    const bool equals = word.back() == '=';
    CLI::Option* const option = find(equals ? word.substr(0, word.size() - 1) : word);
    if (option == nullptr) return;
    if (equals || option->get_items_expected_max() > 0) {
      awaited_ = option;
    } else {
      flag_ = option;
    }
  }

  // Of the flag before, such as --board, which alone means tags.
  Words optionalValues() const {
    CLI::Validator* const words = flag_ == nullptr ? nullptr : offered(flag_, Offer::kWords);
    return words == nullptr ? Words() : wordsOf(words);
  }

  std::vector<CLI::App*> subcommands() const {
    return command_->get_subcommands([](const CLI::App*) { return true; });
  }

  CLI::Option* find(const std::string& name) const {
    for (CLI::App* app = command_; app != nullptr; app = app->get_parent()) {
      if (CLI::Option* const option = app->get_option_no_throw(name)) return option;
    }
    return nullptr;
  }

  Words optionNames() const {
    Words names;
    for (CLI::App* app = command_; app != nullptr; app = app->get_parent()) {
      for (const CLI::Option* option : app->get_options()) {
        for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
      }
    }
    std::sort(names.begin(), names.end());
    names.erase(std::unique(names.begin(), names.end()), names.end());
    return names;
  }

  CLI::Option* nextPositional() const {
    const std::vector<CLI::Option*> all =
        command_->get_options([](const CLI::Option* option) { return option->get_positional(); });
    if (positionals_ < all.size()) return all[positionals_];
    return !all.empty() && takesMany(all.back()) ? all.back() : nullptr;
  }

  CLI::App* command_;
  std::size_t positionals_ = 0;
  CLI::Option* awaited_ = nullptr;  // takes the next word
  bool has_value_ = false;          // and has one already
  CLI::Option* flag_ = nullptr;     // the word before, which may have a value
};

}  // namespace

void printCompletions(CLI::App& app, std::vector<std::string> words, std::ostream& out) {
  words = joinedAtEquals(words);
  const std::string word = words.empty() ? "" : words.back();
  if (!words.empty()) words.pop_back();
  Position position(app);
  for (const std::string& each : words) position.pass(each);
  const Completions found = position.completions(word);
  out << found.files << "\n";
  for (const std::string& each : found.words) {
    if (each.compare(0, word.size(), word) == 0) out << each << "\n";
  }
}

void offer(CLI::Option* option, Offer kind, const Words& words) {
  // Inactive: it checks nothing and is not part of the help.
  const char* const name = kOffers[static_cast<int>(kind)];
  option->check(CLI::Validator(CLI::detail::join(words)).name(name).active(false));
}

}  // namespace helix_arm::cli
