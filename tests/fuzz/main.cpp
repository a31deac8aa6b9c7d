// Replays inputs and changes them at random, with any compiler and without sanitizers:
//
//   fuzz_targets [--target NAME] [--corpus FOLDER] [--regressions FOLDER] [--mutations N | --seconds S] [--seed S] [--crashes FOLDER]
//
// Every file of FOLDER/NAME is run, then so many changed ones of them. Prints a line a target and a JSON line {targets, runs, crashes}; the inputs that
// crash are written to the folder for crashes and named on stderr. Exit status 1 when there were any.
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <chrono>
#include <csignal>
#include <cstring>
#include <ctime>
#include <fstream>
#include <iostream>
#include <iterator>
#include <random>

#include "fuzz/target.h"

namespace {

using namespace lightstage;
namespace fs = std::filesystem;

using Input = std::vector<std::uint8_t>;

struct Options {
  std::string target;
  fs::path corpus, regressions, crashes = "crashes";
  std::size_t mutations = 0;
  double seconds = 0;
  std::uint64_t seed = 1;
};

// What a child that runs a target tells its parent, which survives it.
struct Shared {
  std::size_t runs = 0;  // begun
  std::size_t size = 0;  // of the input that runs
  std::uint8_t input[1 << 20];
};

Shared& shared() {
  static Shared* const memory =
      static_cast<Shared*>(mmap(nullptr, sizeof(Shared), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0));
  fuzz::require(memory != MAP_FAILED, "there is memory");
  return *memory;
}

// Changes in place, several at a time: what libFuzzer's mutations do, without what coverage would tell.
class Mutator {
 public:
  explicit Mutator(std::uint64_t seed) : random_(seed) {}

  Input mutated(const std::vector<Input>& seeds, std::size_t longest) {
    Input input = seeds[below(seeds.size())];
    for (std::size_t changes = 1 + below(6); changes > 0; --changes) change(input, seeds);
    if (input.size() > longest) input.resize(longest);
    return input;
  }

 private:
  std::size_t below(std::size_t n) { return n == 0 ? 0 : random_() % n; }

  void change(Input& input, const std::vector<Input>& seeds) {
    static const std::vector<std::string> kWords{"nan",         "inf",
                                                 "1e999",       "-1",
                                                 "0",           "99999999999999999999",
                                                 "2147483648",  "\xEF\xBB\xBF",
                                                 "\r\n",        "../",
                                                 "/etc/passwd", std::string(1, '\0'),
                                                 "\x1b]0;x\a",  "\xFF\xFE",
                                                 "{",           "[",
                                                 "\"",          "=",
                                                 "{\"a\":",     "[[",
                                                 "\\u0000",     std::string(300, 'a')};
    const std::size_t at = below(input.size() + 1);
    const auto place = input.begin() + std::ptrdiff_t(at);
    switch (below(8)) {
      case 0:
        if (at < input.size()) input[at] ^= std::uint8_t(1 << below(8));
        break;
      case 1:
        if (at < input.size()) input[at] = std::uint8_t(random_());
        break;
      case 2:
        input.insert(place, std::uint8_t(random_()));
        break;
      case 3:
        input.erase(place, place + std::ptrdiff_t(below(std::min<std::size_t>(input.size() - at, 64) + 1)));
        break;
      case 4: {
        const std::string& word = kWords[below(kWords.size())];
        input.insert(place, word.begin(), word.end());
        break;
      }
      case 5: {  // numbers at their ends, as binary formats have them
        static constexpr std::uint8_t kEnds[] = {0x00, 0x01, 0x7F, 0x80, 0xFF};
        for (std::size_t i = at; i < std::min(input.size(), at + (std::size_t(1) << below(4))); ++i) {
          input[i] = kEnds[below(std::size(kEnds))];
        }
        break;
      }
      case 6: {  // a piece of this or another seed
        const Input& other = seeds[below(seeds.size())];
        const std::size_t from = below(other.size() + 1),
                          length = below(std::min<std::size_t>(other.size() - from, 128) + 1);
        const Input piece(other.begin() + std::ptrdiff_t(from), other.begin() + std::ptrdiff_t(from + length));
        input.insert(place, piece.begin(), piece.end());
        break;
      }
      default:
        input.resize(at);
    }
  }

  std::mt19937_64 random_;
};

Input read(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return Input(std::istreambuf_iterator<char>(stream), {});
}

std::vector<Input> inputs_in(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder, none)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Input> inputs;
  for (const fs::path& file : files) inputs.push_back(read(file));
  return inputs;
}

// Those from `first` on: the seeds as they are, then changed ones. Each depends on its number alone, so that a child that ended can be gone on after.
class Inputs {
 public:
  Inputs(const Options& options, const fuzz::Target& target) : options_(options), longest_(target.longest) {
    if (!options.corpus.empty()) seeds_ = inputs_in(options.corpus / target.name);
    if (!options.regressions.empty()) {
      const auto more = inputs_in(options.regressions / target.name);
      seeds_.insert(seeds_.end(), more.begin(), more.end());
    }
    if (seeds_.empty()) seeds_.emplace_back();
  }

  std::size_t seeds() const { return seeds_.size(); }
  Input at(std::size_t number) const {
    if (number < seeds_.size()) return seeds_[number];
    return Mutator(options_.seed * 1'000'003 + number).mutated(seeds_, longest_);
  }

 private:
  const Options& options_;
  std::size_t longest_;
  std::vector<Input> seeds_;
};

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// The input that runs or ran last, as a file.
fs::path keep(const Options& options, const fuzz::Target& target, const std::string& name) {
  return fuzz::write(options.crashes / target.name / name, fuzz::Bytes(shared().input, shared().size));
}

// In the child.
[[noreturn]] void run_from(const Options& options, const fuzz::Target& target, const Inputs& inputs, std::size_t first,
                           std::size_t last, double end) {
  // A picture that claims more than it holds must not be given the machine's memory.
  constexpr rlim_t kMostMemory = rlim_t(4) << 30;
  [[maybe_unused]] const rlimit memory{kMostMemory, kMostMemory};
  const rlimit core{0, 0};
#ifndef __SANITIZE_ADDRESS__  // which maps terabytes for its notes
  setrlimit(RLIMIT_AS, &memory);
#endif
  setrlimit(RLIMIT_CORE, &core);
  constexpr unsigned kLongestRun = 20;  // seconds
  constexpr double kSlow = 3;
  for (std::size_t i = first; i < last && (end == 0 || i < inputs.seeds() || now() < end); ++i) {
    const Input input = inputs.at(i);
    shared().size = std::min(input.size(), sizeof shared().input);
    std::copy_n(input.begin(), shared().size, shared().input);
    shared().runs = i + 1;
    alarm(kLongestRun);
    const double begin = now();
    fuzz::run(target, input);
    if (now() - begin > kSlow) keep(options, target, "slow-" + std::to_string(i + 1));
  }
  alarm(0);
  std::_Exit(0);
}

struct Result {
  std::size_t runs = 0, crashes = 0;
};

Result run_target(const Options& options, const fuzz::Target& target, double end) {
  const Inputs inputs(options, target);
  const std::size_t last =
      end > 0 ? std::numeric_limits<std::size_t>::max() : inputs.seeds() + options.mutations / target.slowness;
  constexpr std::size_t kEnoughCrashes = 20;
  Result result;
  while (result.runs < last && result.crashes < kEnoughCrashes) {
    shared().runs = result.runs;
    std::cout.flush();
    const pid_t child = fork();
    fuzz::require(child >= 0, "a process can be made");
    if (child == 0) run_from(options, target, inputs, result.runs, last, end);
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    result.runs = shared().runs;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) break;
    ++result.crashes;
    const std::string how = WIFSIGNALED(status) ? std::string("signal ") + strsignal(WTERMSIG(status))
                                                : "exit status " + std::to_string(WEXITSTATUS(status));
    const fs::path file = keep(options, target, "input-" + std::to_string(result.runs));
    std::cerr << "crash: " << target.name << ", " << how << ": " << file.string() << "\n";
  }
  return result;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  CLI::App app("Replays inputs of parsers and changes them at random");
  app.add_option("--target", options.target, "Only this one");
  app.add_option("--corpus", options.corpus, "Folder of folders of seeds");
  app.add_option("--regressions", options.regressions, "Folder of folders of inputs that crashed once");
  app.add_option("--crashes", options.crashes, "Where inputs that crash are written to");
  app.add_option("--mutations", options.mutations, "Changed inputs a target");
  app.add_option("--seconds", options.seconds, "Instead: so long a target");
  app.add_option("--seed", options.seed, "Of the changes");
  bool list = false;
  app.add_flag("--list", list, "Print the targets' names");
  CLI11_PARSE(app, argc, argv);

  std::string pattern = (fs::temp_directory_path() / "lightstage-fuzz-XXXXXX").string();
  if (mkdtemp(pattern.data()) == nullptr) return 2;
  Result all;
  std::size_t count = 0;
  for (const fuzz::Target& target : fuzz::targets()) {
    if (list) std::cout << target.name << "\n";
    if (list || (!options.target.empty() && options.target != target.name)) continue;
    setenv("LIGHTSTAGE_FUZZ_SCRATCH", (fs::path(pattern) / target.name).c_str(), 1);
    fs::create_directories(fs::path(pattern) / target.name);
    const double begin = now();
    const Result result = run_target(options, target, options.seconds > 0 ? begin + options.seconds : 0);
    std::printf("%-16s %8zu runs  %3zu crashes  %6.1f s\n", target.name.c_str(), result.runs, result.crashes,
                now() - begin);
    std::fflush(stdout);
    all.runs += result.runs;
    all.crashes += result.crashes;
    ++count;
  }
  std::error_code ignored;
  fs::remove_all(pattern, ignored);
  if (list) return 0;
  std::printf("{\"targets\": %zu, \"runs\": %zu, \"crashes\": %zu}\n", count, all.runs, all.crashes);
  return all.crashes > 0 ? 1 : count > 0 ? 0 : 2;
}
