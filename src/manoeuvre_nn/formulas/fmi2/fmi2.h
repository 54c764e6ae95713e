/* What a co-simulation slave of FMI 2.0 must declare, written after the standard (fmi-standard.org, version 2.0.4). */
#ifndef FMI2_H
#define FMI2_H

#include <stddef.h>

#ifdef FMI2_FUNCTION_PREFIX /* of a tool that links sources of several FMUs into one program */
#define FMI2_PASTE(a, b) a##b
#define FMI2_PASTED(a, b) FMI2_PASTE(a, b)
#define FMI2_NAME(name) FMI2_PASTED(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI2_NAME(name) name
#endif

#if defined _WIN32 || defined __CYGWIN__
#define FMI2_EXPORT __declspec(dllexport)
#elif __GNUC__ >= 4
#define FMI2_EXPORT __attribute__((visibility("default")))
#else
#define FMI2_EXPORT
#endif

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;

#define fmi2True 1
#define fmi2False 0

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

#endif
