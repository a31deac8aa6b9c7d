#include "cli/program.h"

#include <cstdlib>
#include <iostream>
#include <memory>
#include <new>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/printable.h"
#include "core/progress.h"
#include "core/text.h"
#include "core/version.h"

namespace lightstage::cli {

void Context::result(const std::string& text, const nlohmann::ordered_json& object) const {
  if (json) {
    const std::string line = json_text(object);
    // Control characters beyond those that JSON itself escapes.
    const bool shows_all = core::printable(line) == line;
    out_ << (shows_all ? line : object.dump(-1, ' ', true, nlohmann::ordered_json::error_handler_t::replace))
         << std::endl;
  } else {
    out_ << core::printable_lines(text) << std::flush;
  }
}

namespace {

std::filesystem::path default_store() {
  const char* chosen = std::getenv("LIGHTSTAGE_STORE");
  return chosen != nullptr && *chosen != '\0' ? chosen : "store";
}

// As CLI11 writes help, but for what it puts in braces behind flags: the value that they stand for.
class HelpFormatter : public CLI::Formatter {
 public:
  std::string make_option_name(const CLI::Option* option, bool is_positional) const override {
    std::string names = CLI::Formatter::make_option_name(option, is_positional);
    for (auto open = names.find('{'); open != std::string::npos; open = names.find('{')) {
      names.erase(open, names.find('}', open) + 1 - open);
    }
    return names;
  }
};

// The innermost subcommand that the user named.
const CLI::App* named_command(const CLI::App& program) {
  const CLI::App* command = &program;
  while (!command->get_subcommands().empty()) command = command->get_subcommands().back();
  return command;
}

std::vector<std::string> option_names(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::App* level = &command; level != nullptr; level = level->get_parent()) {
    for (const CLI::Option* option : level->get_options()) {
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    }
  }
  return names;
}

std::vector<std::string> subcommand_names(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::App* subcommand : command.get_subcommands({})) names.push_back(subcommand->get_name());
  return names;
}

// "lightstage store ls", for messages that point to a command's help.
std::string full_name(const CLI::App& command) {
  const CLI::App* parent = command.get_parent();
  return parent == nullptr ? command.get_name() : full_name(*parent) + " " + command.get_name();
}

[[noreturn]] void throw_usage_error(const CLI::App& program, const CLI::ParseError& error) {
  const CLI::App& command = *named_command(program);
  const std::string see_help = "; see `" + full_name(command) + " --help`";
  for (const std::string& word : program.remaining(true)) {
    if (word == "--") continue;
    if (word.starts_with("-")) {
      const std::string name = word.substr(0, word.find('='));
      throw core::UsageError("no option '" + name + "'" + core::did_you_mean(name, option_names(command)) + see_help);
    }
    const std::vector<std::string> subcommands = subcommand_names(command);
    const std::string what = subcommands.empty() ? "unexpected argument '" : "no command '";
    throw core::UsageError(what + word + "'" + core::did_you_mean(word, subcommands) + see_help);
  }
  throw core::UsageError(std::string(error.what()) + see_help);
}

void add_all_commands(CLI::App& program, Context& context) {
  add_init(program, context);
  add_stage(program, context);
  add_capture(program, context);
  add_lights_off(program, context);
  add_calibrate(program, context);
  add_merge(program, context);
  add_align(program, context);
  add_import(program, context);
  add_export(program, context);
  add_train(program, context);
  add_model(program, context);
  add_superres(program, context);
  add_relight(program, context);
  add_normals(program, context);
  add_sky(program, context);
  add_analyze_env(program, context);
  add_methods(program, context);
  add_evaluate(program, context);
  add_store(program, context);
  add_doctor(program, context);
  add_bench(program, context);
  add_demo(program, context);
}

}  // namespace

void run_or_throw(const std::vector<std::string>& arguments, std::ostream& out) {
  Context context(out);
  context.store_folder = default_store();
  CLI::App program("Captures, super-resolves and relights light-stage scans.", "lightstage");
  program.formatter(std::make_shared<HelpFormatter>());
  program.footer("Start with:  lightstage demo --out demo");
  program.set_version_flag("--version", std::string("lightstage ") + core::kVersion);
  program.add_option("--store", context.store_folder, "Folder of the store [$LIGHTSTAGE_STORE, else ./store]");
  program.add_flag("--json", context.json, "Print the result as one JSON object");
  program.add_flag("--quiet", context.quiet, "No progress on stderr");
  program.add_option("--threads", context.threads, "Threads to use [all this process may use]")
      ->check(CLI::Range(1, 1024));
  program.fallthrough();
  program.require_subcommand(1);
  program.parse_complete_callback([&context] {
    if (context.store_folder.empty()) throw core::UsageError("--store needs a folder");
    core::set_quiet(context.quiet);
    core::set_thread_count(context.threads);
  });
  add_all_commands(program, context);

  std::vector<std::string> reversed(arguments.rbegin(), arguments.rend());  // as CLI11 takes them
  try {
    program.parse(reversed);
  } catch (const CLI::CallForVersion& version) {
    out << version.what() << "\n";
  } catch (const CLI::CallForHelp&) {
    out << program.help();  // of the innermost command, with its full name
  } catch (const CLI::ParseError& error) {
    throw_usage_error(program, error);
  }
}

int run(const std::vector<std::string>& arguments, std::ostream& out) {
  try {
    run_or_throw(arguments, out);
    return 0;
  } catch (const core::Error& error) {
    std::cerr << "lightstage: " << core::printable(error.what()) << "\n";
    return core::exit_code(error.kind());
  } catch (const std::filesystem::filesystem_error& error) {
    // A path that the system refuses to look at: too long, through a file, or not permitted.
    std::cerr << "lightstage: " << core::printable(error.path1().string() + ": " + error.code().message()) << "\n";
    return core::exit_code(core::ErrorKind::kBadInput);
  } catch (const nlohmann::json::exception& error) {
    std::cerr << "lightstage: the store holds JSON that is not as this program writes it: "
              << core::printable(error.what()) << "\n";
    return core::exit_code(core::ErrorKind::kStore);
  } catch (const std::bad_alloc&) {
    std::cerr << kOutOfMemory;
    return core::exit_code(core::ErrorKind::kInternal);
  } catch (const std::exception& error) {
    std::cerr << "lightstage: internal error: " << core::printable(error.what()) << "\n";
    return core::exit_code(core::ErrorKind::kInternal);
  }
}

}  // namespace lightstage::cli
