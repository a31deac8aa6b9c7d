// `store verify`, `backup`, `restore`, `repair` and `gc`: that nothing is lost.
#pragma once

namespace CLI {
class App;
}

namespace lightstage::cli {

class Context;

void add_store_keeping(CLI::App& store, Context& context);

}  // namespace lightstage::cli
