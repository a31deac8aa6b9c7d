// The plan before the work.
#pragma once

#include <string>
#include <vector>

#include "cli/context.h"
#include "cli/jobs/method_options.h"
#include "cli/relight/environment_options.h"
#include "cli/relight/light_options.h"

namespace lightstage::cli {

// Tells what would be synthesised for every frame whose environment stands otherwise than in the one before, from which captured lights, by which method, and what that would
// take. One picture is synthesised twice, to tell the time of one; nothing is written. Throws UsageError for a goal that is not an error, and as relight does.
void explain(const std::vector<Sequence>& all, const EnvironmentOptions& asked, const MethodChoice& method,
             const std::string& scan, Context& context);

}  // namespace lightstage::cli
