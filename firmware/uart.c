#include "uart.h"

#include <avr/interrupt.h>
#include <string.h>

#include "board.h"

#define BUFFER_SIZE 64  // a power of two

typedef struct {
  volatile uint8_t bytes[BUFFER_SIZE];
  volatile uint8_t head;  // written by the producer alone
  volatile uint8_t tail;  // written by the consumer alone
} Ring;

static Ring received, to_send;

static uint8_t used(const Ring* ring) { return (uint8_t)(ring->head - ring->tail); }

static bool put(Ring* ring, uint8_t byte) {
  if (used(ring) == BUFFER_SIZE) return false;
  ring->bytes[ring->head % BUFFER_SIZE] = byte;
  ++ring->head;
  return true;
}

static uint8_t take(Ring* ring) {
  const uint8_t byte = ring->bytes[ring->tail % BUFFER_SIZE];
  ++ring->tail;
  return byte;
}

void uartStart(void) {
  UCSR0A = _BV(U2X0);
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UBRR0 = (F_CPU + 4 * BAUD) / (8 * BAUD) - 1;
  UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
}

ISR(UART_RX_vect) {
  static bool lost;
  const uint8_t status = UCSR0A;
  const uint8_t byte = UDR0;
  // The mark keeps its place in the stream, however full the buffer was.
  if (status & (_BV(FE0) | _BV(DOR0))) lost = true;
  if (lost) lost = !put(&received, 0);
  if (!(status & _BV(FE0)) && !put(&received, byte)) lost = true;
}

ISR(UART_EMPTY_vect) {
  if (used(&to_send) > 0) {
    UDR0 = take(&to_send);
  } else {
    UCSR0B &= (uint8_t)~_BV(UDRIE0);
  }
}

bool uartTake(uint8_t* byte) {
  if (used(&received) == 0) return false;
  *byte = take(&received);
  return true;
}

bool uartHasInput(void) { return used(&received) > 0; }

void uartSay(const char* text) {
  if (strlen(text) > (uint8_t)(BUFFER_SIZE - used(&to_send))) return;
  while (*text) put(&to_send, (uint8_t)*text++);
  // The interrupt clears the same register.
  const uint8_t interrupts = SREG;
  cli();
  UCSR0B |= _BV(UDRIE0);
  SREG = interrupts;
}
