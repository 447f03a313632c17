// Stands for a plug-in in tests of base/plugin.h; FAKE_PLUGIN_ABI is the number it tells, if any.

extern "C" {

int fake_plugin_answer();
int fake_plugin_answer() { return 42; }

#ifdef FAKE_PLUGIN_ABI
int surfel_plugin_abi();
int surfel_plugin_abi() { return FAKE_PLUGIN_ABI; }
#endif
}
