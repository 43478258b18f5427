// The part of fuzzing that is the same on every machine, for every target:
//   PROGRAM -mutations=COUNT CURRENT WORDS [FILE...]
// runs the inputs FILE.. and COUNT mutations of them, and ends. A mutation depends on its number
// and on these files alone, not on coverage or on time. The present input is in the file CURRENT,
// which stays where it breaks the target. WORDS is a dictionary of libFuzzer.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include <unistd.h>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size);

namespace {

using Inputs = std::vector<std::string>;

constexpr std::size_t kMostSteps = 8, kLongestPart = 64;
constexpr unsigned kPatience = 60;  // of an input, after which a signal ends the program [s]

// SplitMix64: the distributions of the standard library differ between its makers.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  // 0 to count - 1; 0 for none.
  std::size_t below(std::size_t count) {
    std::uint64_t z = state_ += 0x9e3779b97f4a7c15U;
    z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
    return count == 0 ? 0 : static_cast<std::size_t>((z ^ (z >> 31U)) % count);
  }
  const std::string& oneOf(const Inputs& all) { return all[below(all.size())]; }
  std::string partOf(const std::string& text) {
    const std::size_t begin = below(text.size() + 1);
    return text.substr(begin, 1 + below(kLongestPart));
  }
  char byte() { return static_cast<char>(below(256)); }

 private:
  std::uint64_t state_;
};

std::string mutated(const Inputs& kept, const Inputs& words, std::uint64_t number) {
  Random random(number);
  std::string out = random.oneOf(kept);
  for (std::size_t steps = 1 + random.below(kMostSteps); steps > 0; --steps) {
    const std::size_t at = random.below(out.size() + 1), count = 1 + random.below(kLongestPart);
    switch (random.below(7)) {
      case 0:
        if (at < out.size()) out[at] = static_cast<char>(out[at] ^ (1U << random.below(8)));
        break;
      case 1:
        if (at < out.size()) out[at] = random.byte();
        break;
      case 2:
        out.insert(at, std::string(count, random.byte()));
        break;
      case 3:
        out.erase(at, count);
        break;
      case 4:
        out.insert(at, random.partOf(out));
        break;
      case 5:
        out.insert(at, random.partOf(random.oneOf(kept)));
        break;
      default:
        out.insert(at, random.oneOf(words));
    }
  }
  return out;
}

std::string contentOf(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error("cannot read " + path);
  return {std::istreambuf_iterator<char>(file), {}};
}

// The words of a dictionary: one per line in quotes, with \xNN for any byte.
Inputs wordsOf(const std::string& path) {
  std::ifstream file(path);
  Inputs out;
  for (std::string line; std::getline(file, line);) {
    const std::size_t first = line.find('"'), last = line.rfind('"');
    if (first == last) continue;
    std::string word;
    for (std::size_t i = first + 1; i < last; ++i) {
      if (line[i] != '\\') {
        word += line[i];
      } else if (line[++i] == 'x') {
        word += static_cast<char>(std::stoi(line.substr(i + 1, 2), nullptr, 16));
        i += 2;
      } else {
        word += line[i];
      }
    }
    out.push_back(word);
  }
  if (out.empty()) out.emplace_back();
  return out;
}

void run(const std::string& input, const std::string& current) {
  std::ofstream(current, std::ios::binary | std::ios::trunc) << input;
  alarm(kPatience);
  LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(input.data()), input.size());
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  const Inputs arguments(*argv + 1, *argv + *argc);
  const std::string option = "-mutations=";
  if (arguments.size() < 3 || arguments[0].compare(0, option.size(), option) != 0) return 0;
  const std::uint64_t count = std::stoull(arguments[0].substr(option.size()));
  const std::string& current = arguments[1];
  const Inputs words = wordsOf(arguments[2]);
  Inputs kept;
  std::transform(arguments.begin() + 3, arguments.end(), std::back_inserter(kept), contentOf);
  for (const std::string& input : kept) run(input, current);
  const std::size_t files = kept.size();
  if (kept.empty()) kept.emplace_back();
  for (std::uint64_t k = 0; k < count; ++k) run(mutated(kept, words, k), current);
  std::remove(current.c_str());
  std::fprintf(stderr, "stat::number_of_executed_units: %zu\n",
               files + static_cast<std::size_t>(count));
  std::exit(0);
}
