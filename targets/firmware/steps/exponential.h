/* The exponential of a mathematics library: double precision, to half a unit and a little. */
#ifndef EXPONENTIAL_H
#define EXPONENTIAL_H

double exponential(double x);

#endif
