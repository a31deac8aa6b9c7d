// Compiled with the include roots that relight links: core and model, but not db.
#include "model/interpolator.h"
#include "db/store.h"
