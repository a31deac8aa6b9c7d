// Breaks the program on purpose, at many points, and looks what is left: `./run fault`.
#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iostream>
#include <iterator>
#include <map>
#include <random>
#include <set>
#include <sstream>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/parallel.h"
#include "core/progress.h"
#include "db/store.h"
#include "fault/disk.h"
#include "fault/program.h"
#include "fault/scenario.h"
#include "support/support.h"

namespace lightstage::fault {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

// What was broken at one point, and what came of it.
struct Point {
  std::string scenario, fault;
  std::size_t lost = 0;  // frames and pictures that had been acknowledged
  bool clean = true;     // `store verify` has nothing to say but that a pass is not complete
  std::vector<std::string> complaints;
  bool survived() const { return lost == 0 && clean && complaints.empty(); }
};

struct Tally {
  std::size_t injected = 0, survived = 0, lost = 0, unclean = 0;
  void add(const Point& point) {
    ++injected;
    survived += point.survived() ? 1 : 0;
    lost += point.lost;
    unclean += point.clean ? 0 : 1;
  }
};

void copy_folder(const fs::path& from, const fs::path& to) {
  fs::remove_all(to);
  fs::copy(from, to, fs::copy_options::recursive);
}

bool only_incomplete(const std::string& error) {
  return error.find("the frame is missing") != std::string::npos;
}

std::optional<std::string> first_difference(const std::vector<std::string>& is,
                                            const std::vector<std::string>& should) {
  for (std::size_t i = 0; i < std::max(is.size(), should.size()); ++i) {
    const std::string a = i < is.size() ? is[i] : "nothing", b = i < should.size() ? should[i] : "nothing";
    if (a != b) return a + " in place of " + b;
  }
  return std::nullopt;
}

std::string first_line(const std::string& text) {
  const auto end = text.find('\n');
  return text.substr(0, end);
}

class Harness {
 public:
  Harness(fs::path folder, std::uint64_t seed) : folder_(std::move(folder)), random_(seed) {}

  // So many points of one scenario, of which the first is that number of all: kinds of faults take turns over all scenarios.
  std::vector<Point> run(const Scenario& scenario, std::size_t first, std::size_t points) {
    scenario_ = &scenario;
    const fs::path base = folder_ / "base";
    fs::remove_all(base);
    fs::create_directories(base);
    // Commands are given absolute paths: the work is always done in one folder, of which `base` is a copy.
    fs::remove_all(work_);
    fs::create_directories(work_);
    scenario.prepare(work_);
    copy_folder(work_, base);
    before_ = contents(work_ / "store");

    const fs::path count_file = folder_ / "count", record_file = folder_ / "record";
    fs::remove(record_file);
    const Outcome whole = run_program(scenario.command(work_), {work_, "count", count_file, record_file});
    if (whole.status != 0) throw std::runtime_error(scenario.name + " fails undisturbed: " + whole.err);
    long calls = 0, writes = 0, maps = 0, allocations = 0, sqlite_allocations = 0;
    std::ifstream(count_file) >> calls >> writes >> maps >> allocations >> sqlite_allocations;
    reference_ = contents(work_ / "store");

    std::vector<Point> results;
    core::Progress progress(scenario.name, points);
    const std::vector<Change> record = read_record(record_file);
    for (std::size_t i = 0; i < points; ++i, progress.advance()) {
      results.push_back(
          break_one(base, record, (first + i) % 10, {calls, writes, maps, allocations, sqlite_allocations}));
    }
    return results;
  }

 private:
  struct Counts {
    long calls, writes, maps, allocations, sqlite_allocations;
  };

  // Of ten points four kill and two lose power.
  Point break_one(const fs::path& base, const std::vector<Change>& record, std::size_t turn, const Counts& counts) {
    const auto one_of = [&](const char* fault, long count) {
      return disturbed(base, fault + (" " + std::to_string(1 + below(std::max(1L, count)))));
    };
    switch (turn) {
      case 4:
        return disturbed(base, "fail " + std::to_string(1 + below(counts.calls)) + " " +
                                   std::to_string(std::array{EIO, ENOSPC, EDQUOT, EROFS}.at(std::size_t(below(4)))));
      case 5:
        return one_of("full", counts.calls);
      case 6:
        return below(2) == 0 || counts.maps == 0 ? one_of("short", counts.writes) : one_of("map", counts.maps);
      case 7:
        return below(2) == 0 ? one_of("memory", counts.allocations)
                             : one_of("sqlite-memory", counts.sqlite_allocations);
      case 8:
      case 9:
        return power_lost(base, record, std::size_t(below(long(record.size()) + 1)));
      default:
        return one_of("kill", counts.calls);
    }
  }

  long below(long n) { return long(random_() % std::uint64_t(n)); }

  // The record names files in the work folder, so the disk is read from there.
  fs::path base_as_work(const fs::path& base) {
    copy_folder(base, work_);
    return work_;
  }

  Point disturbed(const fs::path& base, const std::string& fault) {
    Point point{scenario_->name, fault, 0, true, {}};
    copy_folder(base, work_);
    const Outcome outcome = run_program(scenario_->command(work_), {work_, fault, {}, {}});
    const bool killed = outcome.status == 128 + 9;
    // With several threads no two runs make quite as many calls: one may be done before its time has come.
    if (killed != fault.starts_with("kill") && outcome.status != 0)
      point.complaints.push_back("was killed, or was not");
    if (!killed && outcome.status != 0) {
      if (outcome.status > 128 || outcome.status == 124) {
        point.complaints.push_back("ended by " + std::to_string(outcome.status) + ": " + first_line(outcome.err));
      } else if (outcome.err.find("lightstage: ") == std::string::npos) {
        point.complaints.push_back("ended with status " + std::to_string(outcome.status) + " without a message");
      } else if (outcome.err.find("internal error") != std::string::npos) {
        point.complaints.push_back("unclear message: " + outcome.err.substr(outcome.err.find("lightstage: ")));
      }
    }
    look_at_what_is_left(point, before_);
    return point;
  }

  Point power_lost(const fs::path& base, const std::vector<Change>& record, std::size_t cut) {
    Point point{scenario_->name, "power " + std::to_string(cut), 0, true, {}};
    Disk disk(base_as_work(base));
    // What was acknowledged last: the rows that programs saw when the log of the catalogue was last synced.
    std::vector<std::string> acknowledged = before_;
    std::size_t last_sync = 0;
    for (std::size_t i = 0; i < cut; ++i) {
      if (record[i].kind == RecordKind::kSync && record[i].path.ends_with("/store/store.sqlite-wal")) last_sync = i + 1;
    }
    for (std::size_t i = 0; i < cut; ++i) {
      disk.apply(record[i]);
      if (i + 1 == last_sync) {
        fs::remove_all(folder_ / "seen");
        disk.write_seen(folder_ / "seen");
        acknowledged = contents(folder_ / "seen/store");
      }
    }
    fs::remove_all(work_);
    disk.write_left(work_, below(4) == 0 ? 0 : random_());
    look_at_what_is_left(point, acknowledged);
    return point;
  }

  // Whatever was acknowledged must be there and sound, the store clean after repair at most, and the command done again must come to the same.
  void look_at_what_is_left(Point& point, const std::vector<std::string>& acknowledged) {
    try {
      const std::vector<std::string> now = contents(work_ / "store");
      const std::set<std::string> there(now.begin(), now.end());
      for (const std::string& line : acknowledged) point.lost += there.contains(line) ? 0 : 1;
      verify(point, "left behind", true);
      const Arguments again = scenario_->again(work_);
      if (!again.empty()) {
        const Outcome outcome = run_program(again, {});
        if (outcome.status != 0)
          point.complaints.push_back("cannot be done again: " + outcome.err.substr(0, outcome.err.size() - 1));
      }
      if (const auto difference = first_difference(contents(work_ / "store"), reference_)) {
        point.complaints.push_back("done again, the store holds something else: " + *difference);
      }
      verify(point, "done again", false);
    } catch (const std::exception& error) {
      point.clean = false;
      point.complaints.push_back(error.what());
    }
  }

  void verify(Point& point, const std::string& when, bool may_be_incomplete) {
    std::error_code none;
    if (!fs::exists(work_ / "store/store.sqlite", none) || fs::is_empty(work_ / "store/store.sqlite")) return;
    db::Store store = db::Store::open(work_ / "store");
    const auto complaints = [&] {
      std::vector<std::string> errors = store.verify().errors;
      if (may_be_incomplete) std::erase_if(errors, only_incomplete);
      return errors;
    };
    std::vector<std::string> errors = complaints();
    if (errors.empty()) return;
    std::vector<fs::path> backups;
    if (fs::exists(work_ / "backup/objects")) backups.push_back(work_ / "backup");
    store.repair(backups);
    errors = complaints();
    if (errors.empty()) return;
    point.clean = false;
    point.complaints.push_back(when + ", not clean: " + errors.front());
  }

  fs::path folder_;
  fs::path work_ = folder_ / "work";
  std::mt19937_64 random_;
  const Scenario* scenario_ = nullptr;
  std::vector<std::string> before_, reference_;
};

int run(int argc, char** argv) {
  CLI::App app("Breaks the program at many points and looks what is left.", "fault_points");
  std::size_t points = 300;
  std::uint64_t seed = 1;
  std::vector<std::string> only;
  fs::path program, shim;
  app.add_option("--program", program, "The program")->required();
  app.add_option("--shim", shim, "The library that disturbs it")->required();
  app.add_option("--points", points, "Points in all, spread over the scenarios")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000));
  app.add_option("--seed", seed, "Which points")->capture_default_str();
  app.add_option("--scenario", only, "Only these");

  CLI11_PARSE(app, argc, argv);
  set_paths(program, shim);
  std::vector<const Scenario*> chosen;
  for (const Scenario& scenario : scenarios()) {
    if (only.empty() || std::find(only.begin(), only.end(), scenario.name) != only.end()) chosen.push_back(&scenario);
  }
  if (chosen.empty()) {
    std::cerr << "fault_points: no such scenario\n";
    return 2;
  }
  const test::TemporaryFolder folder;
  Harness harness(folder.path(), seed);
  Tally all;
  std::map<std::string, std::size_t> by_fault;
  ordered_json by_scenario = ordered_json::object();
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    const std::size_t first = points * i / chosen.size(), share = points * (i + 1) / chosen.size() - first;
    Tally tally;
    for (const Point& point : harness.run(*chosen[i], first, share)) {
      tally.add(point);
      all.add(point);
      ++by_fault[point.fault.substr(0, point.fault.find(' '))];
      for (const std::string& complaint : point.complaints)
        std::cerr << point.scenario << ", " << point.fault << ": " << complaint << "\n";
      if (point.lost > 0) std::cerr << point.scenario << ", " << point.fault << ": " << point.lost << " lost\n";
    }
    by_scenario[chosen[i]->name] = {{"injected", tally.injected}, {"survived", tally.survived}, {"lost", tally.lost}};
  }
  std::cout << ordered_json{{"injected", all.injected},        {"survived", all.survived}, {"lost", all.lost},
                            {"store_clean", all.unclean == 0}, {"faults", by_fault},       {"scenarios", by_scenario}}
                   .dump()
            << std::endl;
  return all.survived == all.injected ? 0 : 1;
}

}  // namespace
}  // namespace lightstage::fault

int main(int argc, char** argv) {
  try {
    lightstage::core::set_quiet(true);
    return lightstage::fault::run(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "fault_points: " << error.what() << "\n";
    return 1;
  }
}
