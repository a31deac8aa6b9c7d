#include "cli/store_keeping.h"

#include <memory>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "cli/context.h"
#include "cli/format.h"
#include "cli/options.h"
#include "core/error.h"
#include "core/text.h"

namespace lightstage::cli {

namespace {

std::string lines(const std::vector<std::string>& list, const std::string& before) {
  std::string text;
  for (const std::string& line : list) text += "  " + before + line + "\n";
  return text;
}

std::string megabytes(std::uint64_t bytes) {
  return fixed(double(bytes) * 1e-6, 1) + " MB";
}

void verify(const db::VerifyOptions& options, Context& context) {
  const db::Store store = db::Store::open(context.store_folder);  // whatever state it is in
  db::VerifyReport report;
  try {
    report = store.verify(options);
  } catch (const core::Interrupted& interrupted) {
    if (!options.scans.empty()) throw;
    throw core::Interrupted(interrupted.what() +
                            std::string("; `lightstage store verify --resume` goes on from there"));
  }
  std::string text = core::counted(report.frames, "frame") + ", " + core::counted(report.objects, "object") + ": " +
                     (report.errors.empty() ? "all sound" : core::counted(report.errors.size(), "error")) + "\n";
  if (report.scans_done_before > 0) {
    text += "  verified before the interruption: " + core::counted(report.scans_done_before, "scan") + "\n";
  }
  text += lines(report.errors, "") + lines(report.notes, "harmless: ");
  context.result(text, {{"ok", report.errors.empty()},
                        {"frames", report.frames},
                        {"objects", report.objects},
                        {"scans_done_before", report.scans_done_before},
                        {"errors", report.errors},
                        {"notes", report.notes}});
  if (!report.errors.empty()) {
    throw core::StoreError(store.folder().string() + ": " + core::counted(report.errors.size(), "error") +
                           " found; `lightstage store repair` mends what there is a sound copy of");
  }
}

void report_copy(const std::string& verb, const db::BackupReport& report, const std::filesystem::path& folder,
                 const Context& context) {
  std::string kept;
  if (!report.kept_catalogue.empty()) {
    const std::string file = report.kept_catalogue.string();
    kept = "  the backup keeps that, by its earlier catalogue " + file + ": `lightstage store repair --from " + file +
           "` brings it back, removing the file lets `store gc` of the backup remove it\n";
  }
  context.result(verb + " " + folder.string() + ": " + core::counted(report.objects, "object") + ", " +
                     std::to_string(report.copied) + " of them copied now (" + megabytes(report.copied_bytes) + ")\n" +
                     lines(report.gone, "no longer in the store: ") + kept + lines(report.damaged, "damaged: "),
                 {{"folder", folder.string()},
                  {"objects", report.objects},
                  {"copied", report.copied},
                  {"copied_bytes", report.copied_bytes},
                  {"gone", report.gone},
                  {"kept_catalogue", report.kept_catalogue.string()},
                  {"damaged", report.damaged}});
  if (!report.damaged.empty()) {
    throw core::StoreError("missing or damaged where they were to be copied from: " +
                           core::counted(report.damaged.size(), "object") + "; see `lightstage store repair`");
  }
}

struct RepairOptions {
  std::vector<std::filesystem::path> backups;
  bool accept_catalogue = false;
};

void repair(const RepairOptions& options, Context& context) {
  const db::CatalogueRepair catalogue =
      db::Store::repair_catalogue(context.store_folder, options.backups, options.accept_catalogue);
  db::Store store = db::Store::open(context.store_folder);
  const db::RepairReport report = store.repair(options.backups);
  std::vector<std::string> lost = catalogue.lost;
  lost.insert(lost.end(), report.lost.begin(), report.lost.end());
  std::string text;
  if (!catalogue.log_copy.empty()) {
    text += "the catalogue's log was damaged: flipped bits put right: " + std::to_string(catalogue.log_bits) +
            ", pages lost: " + std::to_string(catalogue.log_pages_lost) + "\n  the damaged one is kept as " +
            catalogue.log_copy.string() + "\n";
  }
  if (catalogue.made_anew) {
    text += std::string("the catalogue was ") + (catalogue.damaged_copy.empty() ? "missing" : "damaged") +
            " and was made anew: " + core::counted(catalogue.rows_read, "row") + " read from it, " +
            std::to_string(catalogue.rows_from_backups) + " from backups, " + std::to_string(catalogue.rows_dropped) +
            " dropped that referred to lost ones\n";
    if (!catalogue.damaged_copy.empty()) {
      text += "  the damaged one is kept as " + catalogue.damaged_copy.string() + "\n";
    }
  } else if (catalogue.rows_from_backups > 0) {
    text +=
        "taken from backups, since the catalogue lacked them: " + core::counted(catalogue.rows_from_backups, "row") +
        "\n";
  }
  if (catalogue.accepted) text += "the catalogue was taken as it is\n";
  const bool rows_changed =
      catalogue.made_anew || catalogue.accepted || catalogue.rows_from_backups > 0 || !catalogue.log_copy.empty();
  if (report.mended.empty() && lost.empty()) {
    text += rows_changed ? "all objects are sound\n" : "nothing to repair\n";
  } else {
    text +=
        std::to_string(report.mended.size()) + " mended, " + std::to_string(lost.size()) + " without a sound copy\n";
  }
  text += lines(report.mended, "mended: ") + lines(lost, "no copy: ") + lines(catalogue.clashes, "left out: ");
  context.result(text, {{"catalogue",
                         {{"made_anew", catalogue.made_anew},
                          {"damaged_copy", catalogue.damaged_copy.string()},
                          {"rows_read", catalogue.rows_read},
                          {"rows_from_backups", catalogue.rows_from_backups},
                          {"rows_dropped", catalogue.rows_dropped},
                          {"accepted", catalogue.accepted},
                          {"clashes", catalogue.clashes},
                          {"log_copy", catalogue.log_copy.string()},
                          {"log_bits", catalogue.log_bits},
                          {"log_pages_lost", catalogue.log_pages_lost}}},
                        {"mended", report.mended},
                        {"lost", lost}});
  if (!catalogue.lost.empty()) {
    throw core::StoreError(
        store.folder().string() + ": rows of the damaged catalogue are lost: " + catalogue.lost.front() +
        (catalogue.lost.size() > 1 ? " and " + std::to_string(catalogue.lost.size() - 1) + " more" : "") +
        "; name backups with --from, or take frames again (`lightstage capture --resume`) and make again what was "
        "derived. When all that you need is there again, move store.sqlite.damaged-* to another folder");
  }
  if (catalogue.log_pages_lost > 0) {
    throw core::StoreError(
        catalogue.log_copy.string() + ": " + std::to_string(catalogue.log_pages_lost) +
        " pages of the catalogue's log could not be saved: what was stored last before the crash may "
        "be gone; `lightstage store verify` names scans with missing frames");
  }
  if (!report.lost.empty()) {
    throw core::StoreError(store.folder().string() + ": " + "no sound copy of " +
                           core::counted(report.lost.size(), "object") +
                           "; name backups with --from, or take frames again "
                           "(`lightstage capture`) and make again what was derived");
  }
  if (!catalogue.clashes.empty()) {
    throw core::StoreError(store.folder().string() + ": " + std::to_string(catalogue.clashes.size()) +
                           " scans or products of backups were left out, since their name or number is taken here; "
                           "`lightstage store restore` brings them into a store of its own");
  }
}

void collect_garbage(double hours, bool only_look, Context& context) {
  db::Store store = context.open_store();
  const auto age = std::chrono::seconds(std::int64_t(hours * 3600));
  const db::GarbageReport report = store.collect_garbage(age, only_look);
  std::string text = std::string(only_look ? "would remove " : "removed ") + core::counted(report.objects, "object") +
                     " and " + core::counted(report.files, "left-over file") + ", " + megabytes(report.bytes) + "\n";
  if (report.kept_young > 0) {
    text += "  " + std::to_string(report.kept_young) + " that nothing refers to are younger than " + fixed(hours, 1) +
            " hours and stay (--older-than)\n";
  }
  context.result(text, {{"removed", !only_look},
                        {"objects", report.objects},
                        {"files", report.files},
                        {"bytes", report.bytes},
                        {"kept_young", report.kept_young}});
}

void add_verify(CLI::App& store, Context& context) {
  CLI::App* command =
      store.add_subcommand("verify", "Check every row and every object, and the step tables against the pictures");
  command->fallthrough();
  command->footer("Examples:\n  lightstage store verify\n  lightstage store verify head");
  auto options = std::make_shared<db::VerifyOptions>();
  command->add_option("SCAN", options->scans, "Only these scans, with what was derived from them [everything]");
  command->add_flag("--resume", options->resume, "Go on with an interrupted verification of everything");
  command->callback([options, &context] {
    if (options->resume && !options->scans.empty()) {
      throw core::UsageError("store verify: --resume goes on with a verification of everything; name no scans");
    }
    verify(*options, context);
  });
}

void add_backup(CLI::App& store, Context& context) {
  CLI::App* command = store.add_subcommand(
      "backup", "Copy what a folder lacks of this store into it; others may use the store meanwhile");
  command->fallthrough();
  command->footer(
      "Example:\n  lightstage store backup /mnt/disk/head-store\n\nThe same command brings the backup up to date, or "
      "goes on after an interruption. A backup is a store: --store names it. What the store has no more the backup "
      "keeps.");
  auto folder = std::make_shared<std::filesystem::path>();
  command->add_option("FOLDER", *folder, "Where the backup is, or will be")->required();
  command->callback([folder, &context] {
    const db::Store source = context.open_store();
    report_copy("backed up to", source.back_up(*folder), *folder, context);
  });
}

void add_restore(CLI::App& store, Context& context) {
  CLI::App* command = store.add_subcommand("restore", "Make a store (--store) of a backup");
  command->fallthrough();
  command->footer("Example:\n  lightstage store restore /mnt/disk/head-store --store store-again");
  auto backup = std::make_shared<std::filesystem::path>();
  command
      ->add_option("BACKUP", *backup, "Folder of the backup, or an earlier catalogue (store.sqlite.before-TIME) in it")
      ->required();
  command->callback([backup, &context] {
    report_copy("restored", db::Store::restore(*backup, context.store_folder), context.store_folder, context);
  });
}

void add_repair(CLI::App& store, Context& context) {
  CLI::App* command =
      store.add_subcommand("repair", "Mend a damaged catalogue, and damaged and missing objects by sound copies");
  command->fallthrough();
  command->footer("Example:\n  lightstage store repair --from /mnt/disk/head-store");
  auto options = std::make_shared<RepairOptions>();
  command->add_option(
      "--from", options->backups,
      "Backups to take sound copies from, or earlier catalogues (store.sqlite.before-TIME) in them, whose rows "
      "come back; without, only what interrupted writes left");
  command->add_flag(
      "--accept-catalogue", options->accept_catalogue,
      "Take pages of the catalogue that do not match their checksums as they are: another program has written to it");
  command->callback([options, &context] { repair(*options, context); });
}

void add_gc(CLI::App& store, Context& context) {
  CLI::App* command =
      store.add_subcommand("gc", "Remove objects that nothing refers to, and files that interrupted writes left");
  command->fallthrough();
  command->footer("Example:\n  lightstage store rm old --yes\n  lightstage store gc");
  struct Options {
    double hours = 24;
    bool only_look = false;
  };
  auto options = std::make_shared<Options>();
  command
      ->add_option("--older-than", options->hours,
                   "Hours since they were written; 0 only when no other program works on the store")
      ->capture_default_str()
      ->check(number_between(0.0, 1e6));
  command->add_flag("--dry-run", options->only_look, "Only say what would be removed");
  command->callback([options, &context] { collect_garbage(options->hours, options->only_look, context); });
}

}  // namespace

void add_store_keeping(CLI::App& store, Context& context) {
  add_verify(store, context);
  add_backup(store, context);
  add_restore(store, context);
  add_repair(store, context);
  add_gc(store, context);
}

}  // namespace lightstage::cli
